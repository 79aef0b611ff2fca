//! The plan of the paper's tables: training settings ("variants"), each the base setting but for
//! what a row varies, and rows, each a variant at a number of updates.
//!
//! The base is `configs/headline.toml`, one setting for all rows of the paper; the strong policy
//! has its own, `configs/strong.toml`. A policy belongs to a variant where its whole configuration,
//! but for the seed, is the variant's: nobody has to say which row a run serves.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use jostle_ppo::Config;

use jostle_runs::keys::settings;
use jostle_runs::provenance::workspace;

/// A training setting.
#[derive(Debug, PartialEq)]
pub(crate) struct Variant {
    pub(crate) name: &'static str,
    /// A base of its own, below the workspace; `None`: that of the plan.
    base: Option<&'static str>,
    /// Its changes to the base.
    overrides: &'static [&'static [&'static str]],
    /// Numbers of updates at which it is tested; the last is the length of its training.
    pub(crate) updates: &'static [u64],
    /// Training seeds that `--train` uses.
    pub(crate) seeds: &'static [u64],
}

/// The policies that drive the pedestrians: the baseline, trained from seeds of its own.
pub(crate) const POOL: &str = "pool";
/// Seeds from here on are pedestrians', those below are rows'.
const POOL_SEEDS_FROM: u64 = 101;
/// Updates between two checkpoints of a run that `--train` makes.
const CHECKPOINT_EVERY: u64 = 250;

/// One behaviour. Whether α weighs rewards or advantages, and how far apart embeddings start, says
/// nothing where α is 0 and there is one embedding; it moves bits all the same, and is held still
/// so that baselines and pedestrians stay what they are when the base is set otherwise for several
/// behaviours.
const BASELINE: &[&str] =
    &["n_behaviours=1", "intrinsic_reward=none", "alpha=0", "alpha_weighs=reward", "network.embedding_std=3"];

/// All settings.
pub(crate) const VARIANTS: [Variant; 13] = [
    variant("m1", &[BASELINE], &[5_000], &[1, 2, 3]),
    variant("m5", &[&["n_behaviours=5"]], &[5_000], &[1, 2, 3]),
    variant("m10", &[&["n_behaviours=10"]], &[5_000, 10_000], &[1]),
    variant("m20", &[&["n_behaviours=20"]], &[5_000, 20_000], &[1]),
    variant("n10-m1", &[BASELINE, &["n_agents=10"]], &[5_000], &[1]),
    variant("n10-m5", &[&["n_agents=10"]], &[5_000], &[1]),
    variant("n20-m1", &[BASELINE, &["n_agents=20"]], &[5_000], &[1]),
    variant("n20-m5", &[&["n_agents=20"]], &[5_000], &[1]),
    // The weights are the paper's best ones (its Table III).
    variant("state-action", &[&["intrinsic_reward=state_action", "alpha=0.01"]], &[5_000], &[1]),
    variant("state", &[&["intrinsic_reward=state", "alpha=0.03"]], &[5_000], &[1]),
    // Its zones and weights are in `configs/safety_zone.toml`.
    variant(SAFETY_ZONE, &[BASELINE], &[5_000], &[1]),
    variant(POOL, &[BASELINE], &[2_500, 5_000], &[101, 102, 103, 104]),
    Variant { name: STRONG, base: Some(STRONG_FILE), overrides: &[], updates: &[2_035], seeds: &[1, 2, 3] },
];

/// The policy that is meant to be used, not to reproduce the paper.
pub(crate) const STRONG: &str = "strong";
/// Its recipe.
const STRONG_FILE: &str = "configs/strong.toml";

const SAFETY_ZONE: &str = "safety-zone";
/// File with the weights of the safety-zone baseline.
const SAFETY_ZONE_FILE: &str = "configs/safety_zone.toml";

const fn variant(
    name: &'static str,
    overrides: &'static [&'static [&'static str]],
    updates: &'static [u64],
    seeds: &'static [u64],
) -> Variant {
    Variant { name, base: None, overrides, updates, seeds }
}

impl Variant {
    /// The length of its training.
    pub(crate) fn length(&self) -> u64 {
        self.updates.iter().copied().max().unwrap_or(0)
    }

    /// True if a policy of this training seed is one of it.
    fn takes(&self, seed: u64) -> bool {
        (self.name == POOL) == (seed >= POOL_SEEDS_FROM)
    }
}

/// A row of a table: what claims and tables call it.
#[derive(Debug, PartialEq)]
pub(crate) struct RowSpec {
    pub(crate) name: &'static str,
    pub(crate) variant: &'static str,
    pub(crate) updates: u64,
    /// Agents in its test rooms, the robot among them; `None`: as many as in training.
    pub(crate) n_agents: Option<usize>,
    /// Its places in the tables.
    pub(crate) serves: &'static [&'static str],
}

/// All rows.
pub(crate) const ROWS: [RowSpec; 16] = [
    row(
        "m1",
        "m1",
        5_000,
        &[
            "Table 1: M = 1",
            "Table 2: N = 5 without diversity",
            "Table 3: none",
            "Table 4: Basic",
            "Table 5: without diversity",
        ],
    ),
    row(
        "m5",
        "m5",
        5_000,
        &[
            "Table 1: M = 5",
            "Table 2: N = 5 with diversity",
            "Table 3: difference",
            "Table 4: Ours",
            "Table 5: with diversity",
            "figures",
        ],
    ),
    row("m10", "m10", 5_000, &["Table 1: M = 10, 5,000 updates"]),
    row("m20", "m20", 5_000, &["Table 1: M = 20, 5,000 updates"]),
    row("m10-long", "m10", 10_000, &["Table 1: M = 10, 10,000 updates"]),
    row("m20-long", "m20", 20_000, &["Table 1: M = 20, 20,000 updates"]),
    row("n10-m1", "n10-m1", 5_000, &["Table 2: N = 10 without diversity"]),
    row("n10-m5", "n10-m5", 5_000, &["Table 2: N = 10 with diversity"]),
    row("n20-m1", "n20-m1", 5_000, &["Table 2: N = 20 without diversity"]),
    row("n20-m5", "n20-m5", 5_000, &["Table 2: N = 20 with diversity"]),
    row("state-action", "state-action", 5_000, &["Table 3: q(z | s, a)"]),
    row("state", "state", 5_000, &["Table 3: q(z | s)"]),
    row("safety-zone", SAFETY_ZONE, 5_000, &["Table 4: Safe"]),
    strong_row(STRONG, 5, &["the strong policy, N = 5"]),
    strong_row("strong-n10", 10, &["the strong policy, N = 10"]),
    strong_row("strong-n20", 20, &["the strong policy, N = 20"]),
];

const fn row(
    name: &'static str,
    variant: &'static str,
    updates: u64,
    serves: &'static [&'static str],
) -> RowSpec {
    RowSpec { name, variant, updates, n_agents: None, serves }
}

/// The strong policy among so many agents.
const fn strong_row(name: &'static str, n_agents: usize, serves: &'static [&'static str]) -> RowSpec {
    RowSpec { name, variant: STRONG, updates: 2_035, n_agents: Some(n_agents), serves }
}

/// The row of a name that this program knows.
pub(crate) fn row_spec(name: &str) -> &'static RowSpec {
    ROWS.iter().find(|row| row.name == name).expect("rows are named by constants")
}

/// A configuration without the settings that have no effect: with one behaviour both
/// discriminators' answer is always right, so that a baseline stays the same to the bit whatever
/// they are set to (`crates/ppo/tests/contracts.rs` holds this).
fn with_effect(config: &Config) -> Config {
    let mut config = config.clone();
    if config.n_behaviours == 1 {
        config.discriminator = jostle_diversity::DiscriminatorConfig::default();
    }
    config
}

/// The base setting and what every variant makes of it.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    configs: Vec<(&'static Variant, Config)>,
}

impl Plan {
    /// The default base.
    pub(crate) fn default_base() -> PathBuf {
        workspace().join("configs/headline.toml")
    }

    /// The plan on a base setting.
    ///
    /// # Errors
    /// A base that cannot be read, or that a variant makes invalid.
    pub(crate) fn new(base: &Path) -> Result<Self> {
        let zone = workspace().join(SAFETY_ZONE_FILE);
        let none: &[&str] = &[];
        let zone = Config::load(&zone, none)?.sim.reward.safety_zone;
        let config = |variant: &'static Variant| -> Result<(&'static Variant, Config)> {
            let own = variant.base.map(|base| workspace().join(base));
            let mut config = Config::load(own.as_deref().unwrap_or(base), &variant.overrides.concat())?;
            if variant.name == SAFETY_ZONE {
                let missing = || format!("{SAFETY_ZONE_FILE}: no [sim.reward.safety_zone]");
                config.sim.reward.safety_zone = Some(zone.clone().with_context(missing)?);
            }
            Ok((variant, config))
        };
        Ok(Self { configs: VARIANTS.iter().map(config).collect::<Result<_>>()? })
    }

    /// A run of a variant.
    pub(crate) fn run(&self, name: &str, seed: u64) -> Config {
        let (variant, config) = self.of(name);
        Config { seed, updates: variant.length(), checkpoint_every: CHECKPOINT_EVERY, ..config.clone() }
    }

    /// A variant by its name.
    pub(crate) fn variant(&self, name: &str) -> &'static Variant {
        self.of(name).0
    }

    fn of(&self, name: &str) -> &(&'static Variant, Config) {
        self.configs
            .iter()
            .find(|(variant, _)| variant.name == name)
            .expect("variants are named by constants")
    }

    /// The variant that a configuration belongs to.
    ///
    /// # Errors
    /// Where it belongs to none: names the nearest and the settings that differ.
    pub(crate) fn variant_of(&self, config: &Config) -> Result<&'static Variant> {
        let recipe = |config: &Config| Config { seed: 0, ..with_effect(config) }.hash();
        let own = recipe(config);
        let mut fitting = self.configs.iter().filter(|(variant, _)| variant.takes(config.seed));
        if let Some((variant, _)) = fitting.find(|(_, of_plan)| recipe(of_plan) == own) {
            return Ok(variant);
        }
        let without_effect = ["seed", "updates", "checkpoint_every", "threads"];
        let found = settings(&with_effect(config))?;
        let mut nearest: Option<(&str, Vec<String>)> = None;
        for (variant, of_plan) in self.configs.iter().filter(|(variant, _)| variant.takes(config.seed)) {
            let expected = settings(&with_effect(of_plan))?;
            let keys = found.keys().chain(expected.keys().filter(|key| !found.contains_key(*key)));
            let dash = || "nothing".to_owned();
            let differences: Vec<String> = keys
                .filter(|key| {
                    !without_effect.contains(&key.as_str()) && found.get(*key) != expected.get(*key)
                })
                .map(|key| {
                    let of = |map: &std::collections::BTreeMap<String, String>| {
                        map.get(key).cloned().unwrap_or_else(dash)
                    };
                    format!("{key}: found {}, expected {}", of(&found), of(&expected))
                })
                .collect();
            if nearest.as_ref().is_none_or(|(_, least)| differences.len() < least.len()) {
                nearest = Some((variant.name, differences));
            }
        }
        let (name, differences) = nearest.unwrap_or(("none", Vec::new()));
        bail!("its settings are no row's; nearest is {name}: {}", differences.join("; "))
    }

    /// The text of the safety-zone baseline's configuration file: the base's text with the
    /// baseline's settings, and the zone's section as the file has it.
    ///
    /// # Errors
    /// A file without the section, or a base that leaves a setting of the baseline out.
    pub(crate) fn safety_zone_file() -> Result<String> {
        const SECTION: &str = "\n[sim.reward.safety_zone]\n";
        let read = |path: PathBuf| {
            std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
        };
        let (base, old) = (read(Self::default_base())?, read(workspace().join(SAFETY_ZONE_FILE))?);
        let zone = old
            .find(SECTION)
            .map(|at| &old[at + 1..])
            .context("configs/safety_zone.toml: no section of the zone")?;
        let head = "\
            # The safety-zone baseline (after Jin et al. 2020, arXiv:1911.03074, whose constants are not public): the baseline with the\n\
            # terms of [sim.reward.safety_zone], the only part of this file that is edited by hand. The rest follows headline.toml by\n\
            # `cargo xtask reproduce configs`; diversity_m5.toml explains every key.\n";
        let body: Vec<&str> = base.lines().skip_while(|line| line.starts_with('#')).collect();
        let mut text = format!("{head}{}\n\n{zone}", body.join("\n").trim_end());
        for setting in BASELINE {
            let (key, value) = setting.split_once('=').expect("settings are key=value");
            let value = value.parse::<f64>().map_or_else(|_| format!("{value:?}"), |_| value.to_owned());
            // In the file a key stands without its section.
            let name = key.rsplit_once('.').map_or(key, |(_, name)| name);
            let line = text.lines().find(|line| line.split('=').next().map(str::trim) == Some(name));
            let line = line.with_context(|| format!("configs/headline.toml: {key} is left out"))?.to_owned();
            text = text.replacen(&line, &format!("{name} = {value}"), 1);
        }
        Ok(text)
    }

    /// Brings the safety-zone baseline's file into line with the base.
    pub(crate) fn store_safety_zone_file() -> Result<()> {
        jostle_runs::run_folder::write_atomically(
            &workspace().join(SAFETY_ZONE_FILE),
            &Self::safety_zone_file()?,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        Plan::new(&Plan::default_base()).unwrap()
    }

    #[test]
    fn every_row_has_its_variant_and_every_claim_its_row() {
        for row in &ROWS {
            let variant = VARIANTS.iter().find(|variant| variant.name == row.variant).unwrap();
            assert!(variant.updates.contains(&row.updates), "{}", row.name);
        }
        for claim in crate::claims::of_paper::claims() {
            for term in claim.parts.iter().flat_map(|part| &part.terms) {
                assert!(ROWS.iter().any(|row| row.name == term.row), "{}: {}", claim.id, term.row);
            }
        }
    }

    #[test]
    fn every_run_is_recognised_and_no_two_variants_are_one() {
        let plan = plan();
        for variant in &VARIANTS {
            for &seed in variant.seeds {
                assert_eq!(plan.variant_of(&plan.run(variant.name, seed)).unwrap().name, variant.name);
            }
        }
    }

    #[test]
    fn a_foreign_run_is_refused_with_what_differs() {
        let plan = plan();
        let config = Config { gamma: 0.5, ..plan.run("m10", 1) };
        let message = plan.variant_of(&config).unwrap_err().to_string();
        assert!(message.contains("nearest is m10: gamma: found 0.5, expected 0.99"), "{message}");
    }

    #[test]
    fn discriminators_count_where_there_are_behaviours_to_tell_apart() {
        let plan = plan();
        let other = |name, seed| {
            let mut config = plan.run(name, seed);
            config.discriminator.noise_scale += 0.5;
            config
        };
        assert_eq!(plan.variant_of(&other("m1", 1)).unwrap().name, "m1");
        assert_eq!(plan.variant_of(&other(POOL, 101)).unwrap().name, POOL);
        let message = plan.variant_of(&other("m5", 1)).unwrap_err().to_string();
        assert!(message.contains("nearest is m5: discriminator.noise_scale: found"), "{message}");
    }

    #[test]
    fn the_safety_zone_file_follows_the_base() {
        let none: &[&str] = &[];
        let file = Config::load(&workspace().join(SAFETY_ZONE_FILE), none).unwrap();
        let found = plan().variant_of(&file).map(|variant| variant.name);
        let found = found.map_err(|error| format!("run `cargo xtask reproduce configs`: {error}"));
        assert_eq!(found, Ok(SAFETY_ZONE));
        assert_eq!(
            std::fs::read_to_string(workspace().join(SAFETY_ZONE_FILE)).unwrap(),
            Plan::safety_zone_file().unwrap()
        );
    }
}
