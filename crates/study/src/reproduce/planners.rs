//! Planners in the paper's tables: under the learned rows, on the same episodes, and marked as not
//! of the paper.

use crate::claims::{Measure, Row};
use anyhow::Result;
use jostle_arena::Outcome;
use jostle_arena::Planner;
use jostle_eval::compact::CompactEpisode;
use jostle_eval::report::pooled::NO_LABEL;
use jostle_eval::report::{PooledCell, PooledRow, SeedValue, Source};
use jostle_eval::statistics::PairedCounts;
use jostle_peds::CrowdKind;

use super::evaluator::{RowEvaluator, Sites};

/// The note below tables with rows of planners.
pub(super) const NOTE: &str = "planner: not learned and not of the paper (docs/planners.md), on the same episodes. 95 %: Wilson's \
    interval over the episodes. orca and social-force read everyone's true position and velocity, the others the robot's own \
    observation row.";
/// p below which only that is said.
const SMALL_P: f64 = 0.001;

/// A learned row that planners are compared with on paired episodes.
pub(super) struct Reference {
    /// Its name in a note.
    name: &'static str,
    row: Row,
}

impl Reference {
    /// A row under the name that notes give it; `None` where it has no policy.
    pub(super) fn new(name: &'static str, row: &Row) -> Option<Self> {
        (!row.seeds.is_empty()).then(|| Self { name, row: row.clone() })
    }

    /// M = 1 and M = 5, tested among so many agents; rows without a policy are left out.
    pub(super) fn pair(evaluator: &mut RowEvaluator, rows: [&'static str; 2]) -> Result<Vec<Self>> {
        let mut references = Vec::new();
        for (name, row) in ["M = 1", "M = 5"].into_iter().zip(rows) {
            references.extend(Self::new(name, &evaluator.row(row)?.row));
        }
        Ok(references)
    }
}

/// Success of all planners among the six crowds.
pub(super) fn success_rows(
    evaluator: &mut RowEvaluator,
    n_agents: usize,
    labels: impl Fn(Planner) -> Vec<String>,
    references: &[Reference],
) -> Result<Vec<PooledRow>> {
    let mut rows = Vec::new();
    for planner in Planner::IN_TABLES {
        let sites = evaluator.planner(planner, n_agents)?;
        let crowds = CrowdKind::PAPER.each_ref().map(CrowdKind::name);
        let mut cells = cells(sites, &crowds, Measure::Success);
        cells.push(PooledCell::average(&cells.iter().map(Option::as_ref).collect::<Vec<_>>()));
        let note = note(sites, &crowds, references);
        rows.push(row(planner, labels(planner), cells, note));
    }
    Ok(rows)
}

/// A measure of all planners among the six crowds, without a comparison.
pub(super) fn measure_rows(
    evaluator: &mut RowEvaluator,
    label: &str,
    measure: Measure,
) -> Result<Vec<PooledRow>> {
    let mut rows = Vec::new();
    for planner in Planner::IN_TABLES {
        let sites = evaluator.planner(planner, 5)?;
        let cells = cells(sites, &CrowdKind::PAPER.each_ref().map(CrowdKind::name), measure);
        rows.push(row(planner, vec![label.to_owned(), planner.label()], cells, None));
    }
    Ok(rows)
}

/// A row of a planner at any sites.
pub(super) fn site_row(
    planner: Planner,
    sites: &Sites,
    names: &[&str],
    references: &[Reference],
) -> PooledRow {
    row(planner, vec![planner.label()], cells(sites, names, Measure::Success), note(sites, names, references))
}

/// Labels of a planner in a table with so many label columns: its own, then nothing.
pub(super) fn own_label(planner: Planner, columns: usize) -> Vec<String> {
    let rest = std::iter::repeat_n(NO_LABEL.to_owned(), columns.saturating_sub(1));
    std::iter::once(planner.label()).chain(rest).collect()
}

fn row(
    planner: Planner,
    labels: Vec<String>,
    cells: Vec<Option<PooledCell>>,
    note: Option<String>,
) -> PooledRow {
    PooledRow {
        labels,
        paper: vec![None; cells.len()],
        cells,
        decimals: 3,
        sources: vec![Source { policy: planner.identity(), wall_seconds: None }],
        command: None,
        note,
        planner: true,
    }
}

fn cells(sites: &Sites, names: &[&str], measure: Measure) -> Vec<Option<PooledCell>> {
    let cell = |name: &&str| {
        let episodes = sites.get(*name)?;
        let value = if measure == Measure::Success {
            SeedValue::rate(
                0,
                successes(episodes).into_iter().filter(|s| *s).count() as u64,
                episodes.len() as u64,
            )
        } else {
            SeedValue::mean(
                0,
                &episodes.iter().filter_map(|episode| measure.value(episode)).collect::<Vec<_>>(),
            )
        };
        Some(PooledCell::from_seeds(vec![value], measure == Measure::Success))
    };
    names.iter().map(cell).collect()
}

fn successes(episodes: &[CompactEpisode]) -> Vec<bool> {
    episodes.iter().map(|episode| episode.outcome == Outcome::Success).collect()
}

/// Differences of success to each reference by site, with the largest p of `McNemar`'s exact test
/// over its training seeds.
fn note(sites: &Sites, names: &[&str], references: &[Reference]) -> Option<String> {
    let of_reference = |reference: &Reference| {
        let compared: Option<Vec<String>> =
            names.iter().map(|name| compared(name, sites.get(*name)?, reference)).collect();
        Some(format!("against {}: {}", reference.name, compared?.join(", ")))
    };
    let notes: Vec<String> = references.iter().filter_map(of_reference).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// A learned row against a planner on paired episodes, by site. All its training seeds together
/// count as one sample of pairs; as they meet the planner on the same episodes, the largest p of a
/// single seed is given, too.
pub(super) fn pooled_note(row: &Row, planner: Planner, sites: &Sites, names: &[&str]) -> Option<String> {
    let of_site = |name: &&str| {
        let own = successes(sites.get(*name)?);
        let (mut pooled, mut largest) = (PairedCounts::default(), 0.0_f64);
        for seed in &row.seeds {
            let counts = PairedCounts::count(&own, &successes(seed.sites.get(*name)?))?;
            pooled.both += counts.both;
            pooled.first_only += counts.first_only;
            pooled.second_only += counts.second_only;
            pooled.neither += counts.neither;
            largest = largest.max(counts.mcnemar().p_exact);
        }
        let difference = signed(pooled.second_rate()? - pooled.first_rate()?);
        let (won, lost) = (pooled.second_only, pooled.first_only);
        let p = [pooled.mcnemar().p_exact, largest].map(shown_p);
        Some(format!("{name} {difference} ({won} : {lost}, {}; one seed {})", p[0], p[1]))
    };
    let sites: Vec<String> = names.iter().map(of_site).collect::<Option<_>>()?;
    (!row.seeds.is_empty()).then(|| format!("against {planner}: {}", sites.join(", ")))
}

fn compared(site: &str, episodes: &[CompactEpisode], reference: &Reference) -> Option<String> {
    let own = successes(episodes);
    let (mut differences, mut largest) = (Vec::new(), 0.0_f64);
    for seed in &reference.row.seeds {
        let counts = PairedCounts::count(&successes(seed.sites.get(site)?), &own)?;
        differences.push(counts.second_rate()? - counts.first_rate()?);
        largest = largest.max(counts.mcnemar().p_exact);
    }
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    Some(format!("{site} {} ({})", signed(mean), shown_p(largest)))
}

fn signed(difference: f64) -> String {
    format!("{}{:.3}", if difference < 0.0 { "−" } else { "+" }, difference.abs())
}

fn shown_p(p: f64) -> String {
    if p < SMALL_P { format!("p < {SMALL_P}") } else { format!("p = {p:.3}") }
}

#[cfg(test)]
mod tests {
    use crate::claims::SeedRun;
    use jostle_arena::metrics::{EpisodeMetrics, MetricScale};

    use super::*;

    fn episodes(successes: &[bool]) -> Vec<CompactEpisode> {
        let scale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
        let episode = |success: &bool| {
            let outcome = if *success { Outcome::Success } else { Outcome::Timeout };
            CompactEpisode {
                outcome,
                metrics: EpisodeMetrics::from_totals(&scale, outcome, 150, 14.0, 12.0),
                driving: None,
            }
        };
        successes.iter().map(episode).collect()
    }

    #[test]
    fn a_planner_is_compared_with_the_seed_that_is_least_unlike_it() {
        let all = [true; 12];
        let mut half = all;
        half[6..].fill(false);
        let seed = |successes: &[bool]| SeedRun {
            sites: [("VO".to_owned(), episodes(successes))].into(),
            ..SeedRun::default()
        };
        let row = Row { seeds: vec![seed(&half), seed(&all)], shorter: None };
        let references = [Reference { name: "M = 1", row }];
        let own: Sites = [("VO".to_owned(), episodes(&all))].into();
        // Six discordant pairs on one side: p = 2/2⁶ = 0.031 against the first seed, 1 against the
        // second.
        assert_eq!(note(&own, &["VO"], &references).unwrap(), "against M = 1: VO +0.250 (p = 1.000)");
        let first = [Reference { name: "M = 1", row: Row { seeds: vec![seed(&half)], shorter: None } }];
        assert_eq!(note(&own, &["VO"], &first).unwrap(), "against M = 1: VO +0.500 (p = 0.031)");
        assert_eq!(note(&own, &["SF"], &first), None, "nothing to be compared with");
        assert_eq!(note(&own, &["VO"], &[]), None);
    }

    #[test]
    fn seeds_are_pooled_against_a_planner_and_the_weakest_is_named() {
        let all = [true; 12];
        let (mut half, mut one) = (all, all);
        half[6..].fill(false);
        one[0] = false;
        let seed = |successes: &[bool]| SeedRun {
            sites: [("VO".to_owned(), episodes(successes))].into(),
            ..SeedRun::default()
        };
        let row = Row { seeds: vec![seed(&all), seed(&one)], shorter: None };
        let planner: Sites = [("VO".to_owned(), episodes(&half))].into();
        // Twelve pairs won, one lost: p = 2·(1 + 13)/2¹³ = 0.0034; the second seed alone 6 : 1, p =
        // 2·(1 + 7)/2⁷ = 0.125.
        assert_eq!(
            pooled_note(&row, Planner::Dwa, &planner, &["VO"]).unwrap(),
            "against dwa: VO +0.458 (12 : 1, p = 0.003; one seed p = 0.125)"
        );
        assert_eq!(pooled_note(&row, Planner::Dwa, &planner, &["VO", "SF"]), None);
        assert_eq!(pooled_note(&Row::default(), Planner::Dwa, &planner, &["VO"]), None);
    }

    #[test]
    fn a_planner_has_one_label_and_wilsons_interval() {
        let own: Sites = [("warehouse".to_owned(), episodes(&[true; 100]))].into();
        let row = site_row(Planner::Orca, &own, &["warehouse", "hospital"], &[]);
        assert_eq!(row.labels, ["orca (knows positions)"]);
        let cell = row.cells[0].as_ref().unwrap();
        assert_eq!((cell.value, cell.interval), (Some(1.0), jostle_eval::statistics::wilson(100, 100)));
        assert!(row.cells[1].is_none() && row.planner);
        assert_eq!(own_label(Planner::Dwa, 3), ["dwa", "–", "–"]);
    }
}
