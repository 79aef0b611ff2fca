//! Tests of claims on a study: Welch's interval over seeds, the hierarchical bootstrap, an exact
//! permutation test over seeds and `McNemar`'s exact test for each pair of seeds.

use std::collections::BTreeMap;

use serde::Serialize;

use super::study::{SeedRun, Study};
use super::{Claim, Measure, Part, Region, Term, Verdict};
use jostle_arena::Outcome;
use jostle_eval::statistics::bootstrap::{EpisodeDraws, ROUNDS, over_seeds, percentile_interval};
use jostle_eval::statistics::{Contrast, Interval, PairedCounts, Permutation};

/// Level of the intervals.
const LEVEL: f64 = 0.95;

/// The values of a row's seeds in a part, multiplied by the row's weight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// The row.
    pub row: String,
    /// Training seeds.
    pub seeds: Vec<u64>,
    /// A value for each.
    pub values: Vec<f64>,
}

/// Two policies on the same episodes, all sites of the part together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeedPair {
    /// Seed of the first row's policy and of the second's.
    pub seeds: [u64; 2],
    /// Successes; the first of a pair is the first row's.
    pub counts: PairedCounts,
    /// Exact two-sided p.
    pub p_exact: f64,
}

/// A part with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartResult {
    /// The part.
    pub part: Part,
    /// Values by row and seed.
    pub groups: Vec<Group>,
    /// Sum of the rows' means; `None` where a row is missing.
    pub estimate: Option<f64>,
    /// Welch's 95 % interval over training seeds.
    pub welch: Option<Interval>,
    /// Welch's two-sided p of lying at the region's end.
    pub welch_p: Option<f64>,
    /// 95 % interval of the hierarchical bootstrap over seeds and paired episodes.
    pub bootstrap: Option<Interval>,
    /// Exact permutation test over the seeds of two rows.
    pub permutation: Option<Permutation>,
    /// `McNemar`'s test for each pair of seeds, in their order (differences of success alone).
    pub pairs: Vec<SeedPair>,
    /// The verdict at 95 %.
    pub verdict: Verdict,
    /// True if it is contradicted also at the level divided by the number of parts.
    pub contradicted_in_family: bool,
    /// Why it is not more.
    pub reason: Option<String>,
}

/// A claim with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClaimResult {
    /// The claim.
    #[serde(flatten)]
    pub claim: ClaimHead,
    /// The verdict.
    pub verdict: Verdict,
    /// Its parts.
    pub parts: Vec<PartResult>,
    /// Rows that were trained for fewer updates than the paper's: (row, done, of the paper).
    pub shorter: Vec<(String, u64, u64)>,
}

/// A claim without its parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClaimHead {
    /// Short name.
    pub id: &'static str,
    /// The table.
    pub table: &'static str,
    /// The statement.
    pub text: &'static str,
    /// Our reading of it.
    pub reading: &'static str,
}

/// Tests every claim on the study.
pub fn test_claims(study: &Study, claims: &[Claim]) -> Vec<ClaimResult> {
    let mut tester = ClaimTester { study, draws: BTreeMap::new(), means: BTreeMap::new() };
    claims.iter().map(|claim| tester.claim(claim)).collect()
}

/// Key of a seed's bootstrap means: row, seed's index, site, measure.
type SeriesKey = (String, usize, String, Measure);

/// The study with the bootstrap means that several parts share.
struct ClaimTester<'a> {
    study: &'a Study,
    /// By number of episodes.
    draws: BTreeMap<usize, EpisodeDraws>,
    means: BTreeMap<SeriesKey, Vec<f64>>,
}

impl ClaimTester<'_> {
    fn claim(&mut self, claim: &Claim) -> ClaimResult {
        let n_parts = claim.parts.len();
        let parts: Vec<PartResult> = claim.parts.iter().map(|part| self.part(part, n_parts)).collect();
        let mut shorter: Vec<(String, u64, u64)> = Vec::new();
        for term in claim.parts.iter().flat_map(|part| &part.terms) {
            let row = self.study.rows.get(term.row);
            if let Some((done, wanted)) = row.and_then(|row| row.shorter) {
                let entry = (term.row.to_owned(), done, wanted);
                if !shorter.contains(&entry) {
                    shorter.push(entry);
                }
            }
        }
        let all = |verdict| parts.iter().all(|part| part.verdict == verdict);
        let verdict = if parts.iter().any(|part| part.contradicted_in_family) {
            Verdict::Contradicted
        } else if parts.iter().any(|part| part.verdict == Verdict::NotTested) {
            Verdict::NotTested
        } else if all(Verdict::Confirmed) {
            Verdict::Confirmed
        } else {
            Verdict::NotConfirmed
        };
        let Claim { id, table, text, reading, .. } = *claim;
        ClaimResult { claim: ClaimHead { id, table, text, reading }, verdict, parts, shorter }
    }

    fn part(&mut self, part: &Part, n_parts: usize) -> PartResult {
        let mut result = PartResult {
            part: part.clone(),
            groups: Vec::new(),
            estimate: None,
            welch: None,
            welch_p: None,
            bootstrap: None,
            permutation: None,
            pairs: Vec::new(),
            verdict: Verdict::NotTested,
            contradicted_in_family: false,
            reason: None,
        };
        for term in &part.terms {
            match self.group(term, part.measure) {
                // Two terms of one row are the same policies: their values belong together.
                Ok(group) => match result.groups.iter_mut().find(|known| known.row == group.row) {
                    Some(known) => add(&mut known.values, &group.values),
                    None => result.groups.push(group),
                },
                Err(reason) => {
                    result.reason = Some(reason);
                    return result;
                }
            }
        }
        let values: Vec<Vec<f64>> = result.groups.iter().map(|group| group.values.clone()).collect();
        result.estimate = Some(values.iter().map(|v| v.iter().sum::<f64>() / v.len() as f64).sum());
        if let [first, second] = &values[..] {
            // Equal means of the two rows are equal values when the second's sign is turned.
            let turned: Vec<f64> = second.iter().map(|value| -value).collect();
            result.permutation = Permutation::new(first, &turned);
        }
        result.pairs = self.pairs(part);
        let rounds = self.rounds(part);
        result.bootstrap = rounds.as_deref().and_then(|rounds| percentile_interval(rounds, LEVEL));
        let Some(contrast) = Contrast::from_groups(&values) else {
            result.verdict = Verdict::NotConfirmed;
            result.reason =
                Some("one training seed in a row: nothing is known of other trainings".to_owned());
            return result;
        };
        result.welch = Some(contrast.interval(LEVEL));
        result.welch_p = part.region.low.or(part.region.high).and_then(|null| contrast.p_value(null));
        let family = 1.0 - (1.0 - LEVEL) / n_parts as f64;
        // D is a number of the policy: there are no episodes to draw.
        let bootstrap_at = |level| match part.measure {
            Measure::Diversity => Some(contrast.interval(level)),
            _ => rounds.as_deref().and_then(|rounds| percentile_interval(rounds, level)),
        };
        let Some(bootstrap) = bootstrap_at(LEVEL) else {
            result.verdict = Verdict::NotConfirmed;
            result.reason = Some("too few successes to average over".to_owned());
            return result;
        };
        result.verdict = verdict(part.region, [contrast.interval(LEVEL), bootstrap]);
        result.contradicted_in_family = bootstrap_at(family).is_some_and(|ends| {
            verdict(part.region, [contrast.interval(family), ends]) == Verdict::Contradicted
        });
        result
    }

    /// The weighted values of a row's seeds, or what is missing.
    fn group(&self, term: &Term, measure: Measure) -> Result<Group, String> {
        let seeds = self.study.seeds(term.row);
        if seeds.is_empty() {
            return Err(format!("no policy of row {}", term.row));
        }
        let value = |run: &SeedRun| -> Option<f64> {
            if measure == Measure::Diversity {
                return run.diversity;
            }
            let means: Option<Vec<f64>> = term
                .sites
                .iter()
                .map(|site| {
                    let values: Vec<f64> =
                        run.sites.get(*site)?.iter().filter_map(|episode| measure.value(episode)).collect();
                    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
                })
                .collect();
            means.map(|means| means.iter().sum::<f64>() / means.len() as f64)
        };
        let values: Option<Vec<f64>> = seeds.iter().map(|run| Some(term.weight * value(run)?)).collect();
        let values = values.ok_or_else(|| format!("row {} has nothing to average over", term.row))?;
        Ok(Group { row: term.row.to_owned(), seeds: seeds.iter().map(|run| run.seed).collect(), values })
    }

    /// `McNemar`'s test where the part is the difference of two rows' success.
    fn pairs(&self, part: &Part) -> Vec<SeedPair> {
        let (Measure::Success, [first, second]) = (part.measure, &part.terms[..]) else { return Vec::new() };
        if first.weight != -second.weight || first.sites != second.sites {
            return Vec::new();
        }
        let successes = |run: &SeedRun, site: &str| -> Vec<bool> {
            let episodes = run.sites.get(site).map_or(&[][..], |episodes| episodes);
            episodes.iter().map(|episode| episode.outcome == Outcome::Success).collect()
        };
        let runs = self.study.seeds(first.row).iter().zip(self.study.seeds(second.row));
        runs.filter_map(|(a, b)| {
            let mut total = PairedCounts::default();
            for site in &first.sites {
                let counts = PairedCounts::count(&successes(a, site), &successes(b, site))?;
                total.both += counts.both;
                total.first_only += counts.first_only;
                total.second_only += counts.second_only;
                total.neither += counts.neither;
            }
            Some(SeedPair { seeds: [a.seed, b.seed], counts: total, p_exact: total.mcnemar().p_exact })
        })
        .collect()
    }

    /// The part's sum in every round of the bootstrap; `None` without episodes.
    fn rounds(&mut self, part: &Part) -> Option<Vec<f64>> {
        if part.measure == Measure::Diversity {
            return None;
        }
        let mut groups: Vec<(&str, Vec<Vec<f64>>)> = Vec::new();
        for term in &part.terms {
            let n_seeds = self.study.seeds(term.row).len();
            let seeds: Option<Vec<Vec<f64>>> =
                (0..n_seeds).map(|seed| self.weighted_rounds(term, seed, part.measure)).collect();
            let seeds = seeds?;
            match groups.iter_mut().find(|(row, _)| *row == term.row) {
                Some((_, known)) => {
                    known.iter_mut().zip(&seeds).for_each(|(known, more)| add(known, more));
                }
                None => groups.push((term.row, seeds)),
            }
        }
        Some(over_seeds(&groups.into_iter().map(|(_, seeds)| seeds).collect::<Vec<_>>()))
    }

    /// One seed's weighted mean over the term's sites in every round.
    fn weighted_rounds(&mut self, term: &Term, seed: usize, measure: Measure) -> Option<Vec<f64>> {
        let factor = term.weight / term.sites.len() as f64;
        let mut sum = vec![0.0; ROUNDS];
        for site in &term.sites {
            let study = self.study;
            let episodes = study.seeds(term.row).get(seed)?.sites.get(*site).filter(|e| !e.is_empty())?;
            let key = (term.row.to_owned(), seed, (*site).to_owned(), measure);
            let draws = &mut self.draws;
            let means = self.means.entry(key).or_insert_with(|| {
                let n = episodes.len();
                let values: Vec<Option<f64>> =
                    episodes.iter().map(|episode| measure.value(episode)).collect();
                draws.entry(n).or_insert_with(|| EpisodeDraws::new(n, ROUNDS)).means(&values)
            });
            for (sum, mean) in sum.iter_mut().zip(means) {
                *sum += factor * *mean;
            }
        }
        Some(sum)
    }
}

fn add(sum: &mut [f64], more: &[f64]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

/// Confirmed where both intervals lie in the region, contradicted where both lie outside.
fn verdict(region: Region, intervals: [Interval; 2]) -> Verdict {
    let inside = |interval: &Interval| {
        region.low.is_none_or(|low| interval.low > low) && region.high.is_none_or(|high| interval.high < high)
    };
    let outside = |interval: &Interval| {
        region.low.is_some_and(|low| interval.high < low)
            || region.high.is_some_and(|high| interval.low > high)
    };
    match intervals {
        _ if intervals.iter().all(inside) => Verdict::Confirmed,
        _ if intervals.iter().all(outside) => Verdict::Contradicted,
        _ => Verdict::NotConfirmed,
    }
}
