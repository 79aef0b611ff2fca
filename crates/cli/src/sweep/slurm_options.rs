//! `[slurm]` of a plan: the options that a job array is submitted with.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};

use super::section::Section;

/// `[slurm]` of a plan; what is left out is the cluster's default.
#[derive(Debug, Default, Clone)]
pub(crate) struct SlurmPlan {
    pub(super) partition: Option<String>,
    pub(super) time: Option<String>,
    pub(super) memory: Option<String>,
    pub(super) account: Option<String>,
    /// Names for `module load`.
    pub(super) modules: Vec<String>,
    /// Further options of `sbatch`, such as `--constraint=avx512`.
    pub(super) options: Vec<String>,
    /// Most elements of the array that run at a time.
    pub(super) at_a_time: Option<usize>,
}

impl SlurmPlan {
    /// Reads the section.
    pub(crate) fn read(mut section: Section) -> Result<Self> {
        let plan = Self {
            partition: section.optional("partition", "a name")?,
            time: section.optional("time", "a text such as \"12:00:00\"")?,
            memory: section.optional("memory", "a text such as \"4G\"")?,
            account: section.optional("account", "a name")?,
            modules: section.optional("modules", "a list of names")?.unwrap_or_default(),
            options: section.optional("options", "a list of options of sbatch")?.unwrap_or_default(),
            at_a_time: section.optional("at_a_time", "a number of runs")?,
        };
        ensure!(plan.at_a_time != Some(0), section.refusal("at_a_time", "0", "at least 1"));
        let texts = [
            ("partition", &plan.partition),
            ("time", &plan.time),
            ("memory", &plan.memory),
            ("account", &plan.account),
        ];
        let texts = texts.iter().flat_map(|(key, text)| text.iter().map(|text| (*key, text)));
        let lists = [("modules", &plan.modules), ("options", &plan.options)];
        let lists = lists.iter().flat_map(|(key, list)| list.iter().map(|text| (*key, text)));
        for (key, text) in texts.chain(lists) {
            // A line break would be a line of the script.
            let fits = !text.is_empty() && !text.chars().any(char::is_control);
            ensure!(fits, section.refusal(key, &format!("{text:?}"), "a text of one line"));
        }
        section.finish()?;
        Ok(plan)
    }

    /// A file whose keys are those of `[slurm]`.
    pub(crate) fn load(path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {place}"))?;
        Self::read(Section::of_text(&place, &text)?)
    }

    /// The same as a section.
    pub(super) fn table(&self) -> toml::Table {
        let mut table = toml::Table::new();
        let texts = [
            ("partition", &self.partition),
            ("time", &self.time),
            ("memory", &self.memory),
            ("account", &self.account),
        ];
        for (key, text) in texts {
            table.extend(text.iter().map(|text| (key.to_owned(), text.clone().into())));
        }
        for (key, list) in [("modules", &self.modules), ("options", &self.options)] {
            table.insert(key.to_owned(), list.clone().into());
        }
        table.extend(self.at_a_time.map(|most| ("at_a_time".to_owned(), (most as i64).into())));
        table
    }
}
