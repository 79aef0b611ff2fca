//! The verdicts on the paper's claims, as text, Markdown, CSV, LaTeX and JSON.

use std::fmt::Write as _;

use crate::claims::{ClaimResult, Measure, PartResult};
use jostle_eval::report::grid::{Grid, csv_line};
use jostle_eval::report::pooled::latex;
use jostle_eval::statistics::Interval;

/// The rule, printed with every report.
pub const RULE: &str = "Rule: each part of a claim is a sum of means over training seeds with two 95 % intervals, Welch's \
    over training seeds and a hierarchical bootstrap over seeds and paired episodes (10,000 rounds, fixed ChaCha8 streams). \
    Confirmed: both intervals of every part lie in the claimed region. Contradicted: both intervals of at least one part lie \
    outside it, at the level 0.05 divided by the number of parts. Not confirmed: anything else, also a row with one training \
    seed. Not tested: a row without a policy. With three seeds a permutation test cannot give p below 0.1, the bootstrap's \
    interval is too short, and Welch's rests on the seeds' values being roughly normal: it decides.";

/// Verdicts with their evidence for a terminal: a line for each claim.
pub fn text(results: &[ClaimResult]) -> String {
    let mut text = String::from("The paper's claims\n\n");
    for result in results {
        let _ = writeln!(text, "{:13}  {}  {}", result.verdict.name(), result.claim.table, result.claim.text);
        for reason in reasons(result) {
            let _ = writeln!(text, "               {reason}");
        }
    }
    let _ = writeln!(text, "\n{RULE}");
    text
}

/// As Markdown: a table of the verdicts, then the parts of every claim that could be tested.
pub fn markdown(results: &[ClaimResult]) -> String {
    let mut grid = Grid::new(["claim", "table", "what the paper says", "verdict"]);
    for result in results {
        let mut words = result.claim.text.to_owned();
        if !result.claim.reading.is_empty() {
            let _ = write!(words, " *{}*", result.claim.reading);
        }
        let verdict = format!("**{}**", result.verdict.name());
        grid.push(false, vec![result.claim.id.to_owned(), result.claim.table.to_owned(), words, verdict]);
    }
    let mut text = format!("## The paper's claims\n\n{}\n{RULE}\n", grid.markdown());
    for result in results.iter().filter(|result| result.parts.iter().any(|part| part.estimate.is_some())) {
        let _ = write!(text, "\n### {}: {}\n\n", result.claim.id, result.verdict.name());
        for reason in reasons(result) {
            let _ = writeln!(text, "{reason}\n");
        }
        text += &parts(result).markdown();
    }
    text
}

/// As CSV, a line for each part.
pub fn csv(results: &[ClaimResult]) -> String {
    let mut text = csv_line([
        "claim",
        "table",
        "verdict",
        "part",
        "measure",
        "part_verdict",
        "estimate",
        "welch_low",
        "welch_high",
        "welch_p",
        "bootstrap_low",
        "bootstrap_high",
        "permutation_p",
        "permutation_least_p",
        "mcnemar_p",
        "seeds",
    ]);
    let float = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    for result in results {
        for part in &result.parts {
            let ends = |interval: Option<Interval>| {
                [float(interval.map(|ends| ends.low)), float(interval.map(|ends| ends.high))]
            };
            let ([welch_low, welch_high], [low, high]) = (ends(part.welch), ends(part.bootstrap));
            let exact: Vec<String> = part.pairs.iter().map(|pair| pair.p_exact.to_string()).collect();
            let seeds: Vec<String> =
                part.groups.iter().map(|group| format!("{}: {}", group.row, group.seeds.len())).collect();
            text += &csv_line([
                result.claim.id.to_owned(),
                result.claim.table.to_owned(),
                result.verdict.name().to_owned(),
                part.part.label.clone(),
                unit(part.part.measure).0.to_owned(),
                part.verdict.name().to_owned(),
                float(part.estimate),
                welch_low,
                welch_high,
                float(part.welch_p),
                low,
                high,
                float(part.permutation.map(|test| test.p)),
                float(part.permutation.map(|test| test.least_p)),
                exact.join(" "),
                seeds.join(" "),
            ]);
        }
    }
    text
}

/// As a LaTeX table of the verdicts.
pub fn latex_table(results: &[ClaimResult]) -> String {
    let mut text = String::from(
        "% Made by `cargo xtask reproduce claims`.\n\\begin{tabular}{lp{0.6\\linewidth}l}\n\\toprule\nTable & Claim & Verdict \
         \\\\\n\\midrule\n",
    );
    for result in results {
        let fields = [result.claim.table, result.claim.text, result.verdict.name()].map(latex);
        let _ = writeln!(text, "{} \\\\", fields.join(" & "));
    }
    text + "\\bottomrule\n\\end{tabular}\n"
}

/// As JSON, with everything.
pub fn json(results: &[ClaimResult]) -> String {
    serde_json::to_string_pretty(results).expect("verdicts are always JSON") + "\n"
}

fn parts(result: &ClaimResult) -> Grid {
    let mut grid = Grid::new([
        "part",
        "estimate",
        "95 % over seeds (Welch)",
        "p",
        "95 % bootstrap",
        "permutation p (least possible)",
        "McNemar p by pair of seeds",
        "verdict",
    ]);
    for part in &result.parts {
        grid.push(false, part_line(part));
    }
    grid
}

fn part_line(part: &PartResult) -> Vec<String> {
    let (name, decimals) = unit(part.part.measure);
    let dash = || "–".to_owned();
    let ends = |interval: Option<Interval>| {
        interval.map_or_else(dash, |ends| format!("{:+.decimals$} to {:+.decimals$}", ends.low, ends.high))
    };
    let exact: Vec<String> = part.pairs.iter().map(|pair| p_value(pair.p_exact)).collect();
    vec![
        format!("{} ({name})", part.part.label),
        part.estimate.map_or_else(dash, |value| format!("{value:+.decimals$}")),
        ends(part.welch),
        part.welch_p.map_or_else(dash, p_value),
        ends(part.bootstrap),
        part.permutation.map_or_else(dash, |test| format!("{} ({})", p_value(test.p), p_value(test.least_p))),
        if exact.is_empty() { dash() } else { exact.join(", ") },
        part.verdict.name().to_owned(),
    ]
}

/// The limits of a verdict, each once.
fn reasons(result: &ClaimResult) -> Vec<String> {
    let mut reasons: Vec<String> = Vec::new();
    for part in &result.parts {
        if let Some(reason) = part.reason.as_ref().filter(|reason| !reasons.contains(reason)) {
            reasons.push(reason.clone());
        }
    }
    reasons.extend(
        result.shorter.iter().map(|(row, done, wanted)| {
            format!("{row} was trained for {done} of the paper's {wanted} updates")
        }),
    );
    reasons
}

fn p_value(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

/// Name with unit, and decimals.
fn unit(measure: Measure) -> (&'static str, usize) {
    match measure {
        Measure::Success => ("success", 3),
        Measure::Collision => ("collisions", 3),
        Measure::CollisionMinusTimeout => ("share", 3),
        Measure::ExtraTime => ("extra time, s", 2),
        Measure::ExtraDistance => ("extra distance, m", 2),
        Measure::AverageSpeed => ("speed, m/s", 3),
        Measure::Diversity => ("D, nats", 3),
    }
}
