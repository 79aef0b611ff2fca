//! Verdicts on made-up studies whose answer is known.

use std::collections::BTreeMap;

use jostle_arena::Outcome;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};
use jostle_eval::compact::CompactEpisode;
use jostle_study::claims::of_paper::{CROWDS, MAPS, claims};
use jostle_study::claims::{Measure, Row, SeedRun, Study, Verdict, test_claims};
use jostle_study::verdicts;

const SCALE: MetricScale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
const EPISODES: u64 = 200;

/// `successes` of [`EPISODES`] episodes reach a goal at 10 m in `steps` steps; the others crash.
fn episodes(successes: u64, steps: u64) -> Vec<CompactEpisode> {
    (0..EPISODES)
        .map(|k| {
            // Spread over the indices, so that two policies of like rates succeed on like episodes.
            let success = k * 77 % EPISODES < successes;
            let outcome = if success { Outcome::Success } else { Outcome::CollisionPedestrian };
            let metrics = EpisodeMetrics::from_totals(&SCALE, outcome, steps + k % 3, 9.6, 10.0);
            CompactEpisode { outcome, metrics, driving: None }
        })
        .collect()
}

fn row(successes: &[u64], steps: u64, diversity: f64) -> Row {
    let sites = |successes| -> BTreeMap<String, Vec<CompactEpisode>> {
        CROWDS.iter().chain(&MAPS).map(|site| ((*site).to_owned(), episodes(successes, steps))).collect()
    };
    let seeds = successes.iter().zip(1..).map(|(successes, seed)| SeedRun {
        seed,
        sites: sites(*successes),
        diversity: Some(diversity + seed as f64 * 0.01),
    });
    Row { seeds: seeds.collect(), shorter: None }
}

fn study(rows: &[(&str, Row)]) -> Study {
    Study { rows: rows.iter().map(|(name, row)| ((*name).to_owned(), row.clone())).collect() }
}

fn verdict(study: &Study, id: &str) -> Verdict {
    let found = claims().into_iter().filter(|claim| claim.id == id).collect::<Vec<_>>();
    assert_eq!(found.len(), 1, "{id}");
    test_claims(study, &found)[0].verdict
}

#[test]
fn clear_differences_are_confirmed_and_contradicted() {
    let (low, high) = (row(&[100, 104, 97], 110, 0.0), row(&[150, 153, 149], 105, 0.5));
    let as_claimed = study(&[("m1", low.clone()), ("m5", high.clone())]);
    for id in ["headline", "headline-each-crowd", "fewer-collisions-without-more-time", "deployment"] {
        assert_eq!(verdict(&as_claimed, id), Verdict::Confirmed, "{id}");
    }
    let reversed = study(&[("m1", high), ("m5", low)]);
    for id in ["headline", "headline-each-crowd", "faster-and-shorter", "deployment"] {
        assert_eq!(verdict(&reversed, id), Verdict::Contradicted, "{id}");
    }
}

#[test]
fn seeds_that_vary_more_than_rows_confirm_nothing() {
    let study = study(&[("m1", row(&[60, 120, 180], 110, 0.0)), ("m5", row(&[90, 150, 190], 110, 0.5))]);
    let headline = &claims()[..1];
    let result = &test_claims(&study, headline)[0];
    assert_eq!(result.verdict, Verdict::NotConfirmed);
    let part = &result.parts[0];
    // Each pair of policies differs far beyond chance; trainings do not.
    assert!(part.pairs.iter().all(|pair| pair.p_exact < 0.001), "{:?}", part.pairs);
    assert!((part.estimate.unwrap() - (430.0 - 360.0) / 600.0).abs() < 1e-12);
    let welch = part.welch.unwrap();
    assert!(welch.low < 0.0 && welch.high > 0.0);
    assert_eq!(part.permutation.unwrap().least_p, 0.1);
}

#[test]
fn one_seed_and_missing_rows_are_said() {
    let single = study(&[("m1", row(&[100], 110, 0.0)), ("m5", row(&[190], 110, 0.5))]);
    let result = &test_claims(&single, &claims()[..1])[0];
    assert_eq!(result.verdict, Verdict::NotConfirmed);
    assert!(result.parts[0].reason.as_deref().unwrap().contains("one training seed"));
    assert!(result.parts[0].pairs[0].p_exact < 1e-9 && result.parts[0].welch.is_none());
    assert_eq!(verdict(&single, "more-updates"), Verdict::NotTested);
    assert_eq!(verdict(&single, "beats-safety-zone"), Verdict::NotTested);
    let mut short = single;
    short.rows.get_mut("m5").unwrap().shorter = Some((3000, 5000));
    assert_eq!(test_claims(&short, &claims()[..1])[0].shorter, [("m5".to_owned(), 3000, 5000)]);
}

#[test]
fn a_match_is_a_region_and_not_a_missing_difference() {
    let near = study(&[
        ("m5", row(&[150, 151, 152], 110, 0.5)),
        ("m10-long", row(&[151, 152, 150], 110, 0.5)),
        ("m20-long", row(&[150, 151, 152], 110, 0.5)),
    ]);
    assert_eq!(verdict(&near, "more-updates-match"), Verdict::Confirmed);
    let wide = study(&[
        ("m5", row(&[120, 150, 180], 110, 0.5)),
        ("m10-long", row(&[121, 151, 179], 110, 0.5)),
        ("m20-long", row(&[120, 150, 180], 110, 0.5)),
    ]);
    assert_eq!(verdict(&wide, "more-updates-match"), Verdict::NotConfirmed);
}

#[test]
fn crowds_of_one_row_are_compared_within_each_seed() {
    // Every seed has the same gap between crowds although seeds differ much.
    let mut policies = row(&[60, 120, 180], 110, 0.0);
    for seed in &mut policies.seeds {
        let successes = |run: &[CompactEpisode]| run.iter().filter(|e| e.outcome == Outcome::Success).count();
        let base = successes(&seed.sites["NH"]) as u64;
        for site in ["NH", "VA"] {
            seed.sites.insert(site.to_owned(), episodes(base + 15 + seed.seed, 110));
        }
    }
    let study = study(&[("m1", policies.clone()), ("m5", policies)]);
    assert_eq!(verdict(&study, "non-reactive-harder-as-defined"), Verdict::Confirmed);
}

#[test]
fn d_is_tested_over_seeds_alone() {
    let study = study(&[
        ("m5", row(&[150; 3], 110, 1.1)),
        ("state-action", row(&[150; 3], 110, 0.5)),
        ("state", row(&[150; 3], 110, 0.2)),
    ]);
    assert_eq!(verdict(&study, "diversity-order"), Verdict::Confirmed);
    assert_eq!(verdict(&study, "regularised-beats-unregularised"), Verdict::NotConfirmed);
}

#[test]
fn claims_are_told_apart_and_complete() {
    let claims = claims();
    let mut ids: Vec<&str> = claims.iter().map(|claim| claim.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), claims.len());
    for claim in &claims {
        assert!(!claim.parts.is_empty());
        for part in &claim.parts {
            let of_episodes = part.measure != Measure::Diversity;
            assert!(part.terms.iter().all(|term| term.sites.is_empty() != of_episodes), "{}", part.label);
        }
    }
    for table in ["Table 1", "Table 2", "Table 3", "Table 4", "Table 5"] {
        assert!(claims.iter().any(|claim| claim.table == table));
    }
}

#[test]
fn every_format_tells_the_same_verdicts_with_their_evidence() {
    let mut study = study(&[("m1", row(&[100, 104, 97], 110, 0.0)), ("m5", row(&[150, 153, 149], 105, 0.5))]);
    study.rows.get_mut("m5").unwrap().shorter = Some((3000, 5000));
    let wanted = ["headline", "headline-each-crowd", "more-updates"];
    let claims: Vec<_> = claims().into_iter().filter(|claim| wanted.contains(&claim.id)).collect();
    let results = test_claims(&study, &claims);
    let names: Vec<&str> = results.iter().map(|result| result.verdict.name()).collect();
    let confirmed = Verdict::Confirmed.name();
    assert_eq!(names, [confirmed, confirmed, Verdict::NotTested.name()]);

    let text = verdicts::text(&results);
    for (result, name) in results.iter().zip(&names) {
        assert!(
            text.contains(&format!("{name:13}  {}  {}", result.claim.table, result.claim.text)),
            "{text}"
        );
    }
    assert!(
        text.contains("m5 was trained for 3000 of the paper's 5000 updates") && text.contains(verdicts::RULE)
    );

    let markdown = verdicts::markdown(&results);
    assert_eq!(
        markdown.matches("\n### ").count(),
        2,
        "a claim that was not tested has no evidence: {markdown}"
    );
    // 150 + 153 + 149 of 600 against 100 + 104 + 97.
    assert!(markdown.contains("| +0.252 |"), "{markdown}");

    let csv = verdicts::csv(&results);
    let fields = csv.lines().next().unwrap().split(',').count();
    let parts: usize = results.iter().map(|result| result.parts.len()).sum();
    assert_eq!((fields, csv.lines().count()), (16, 1 + parts));
    let headline = csv.lines().find(|line| line.starts_with("headline,")).unwrap();
    assert!(headline.contains("m5: 3") && headline.contains("m1: 3"), "{headline}");

    let latex = verdicts::latex_table(&results);
    assert!(names.iter().all(|name| latex.contains(&format!("& {name} \\\\"))), "{latex}");
    let json: serde_json::Value = serde_json::from_str(&verdicts::json(&results)).unwrap();
    assert_eq!(json[0]["parts"][0]["pairs"].as_array().unwrap().len(), 3);
}
