//! Every comparison that the paper's text makes on its Tables I to V.
//!
//! `reading` says where the paper's own figures break its sentence. Margins are ours and are part
//! of the claim.

use super::{Claim, Measure, Part, Region, Term};

/// The six crowds by the paper's names.
pub const CROWDS: [&str; 6] = ["NH", "IN", "VA", "SO", "VO", "SF"];
/// The two maps of Table V.
pub const MAPS: [&str; 2] = ["warehouse", "hospital"];
/// Success rates this near to each other count as a match.
const MATCH: f64 = 0.05;
/// Time (s) and distance (m) that are no addition: two control periods, and the way made in them.
const NO_ADDITION: f64 = 0.2;

fn term(row: &'static str, weight: f64, sites: &[&'static str]) -> Term {
    Term { row, weight, sites: sites.to_vec() }
}

/// First row minus second row.
fn over(measure: Measure, better: &'static str, worse: &'static str, sites: &[&'static str]) -> Part {
    let place = match sites {
        [] => String::new(),
        [site] => format!(", {site}"),
        _ => ", mean of the crowds".to_owned(),
    };
    Part {
        label: format!("{better} − {worse}{place}"),
        measure,
        terms: vec![term(better, 1.0, sites), term(worse, -1.0, sites)],
        region: Region::POSITIVE,
    }
}

fn on_average(better: &'static str, worse: &'static str) -> Part {
    over(Measure::Success, better, worse, &CROWDS)
}

fn in_each(better: &'static str, worse: &'static str) -> Vec<Part> {
    CROWDS.iter().map(|crowd| over(Measure::Success, better, worse, &[crowd])).collect()
}

fn less(measure: Measure, less: &'static str, more: &'static str) -> Part {
    over(measure, more, less, &CROWDS)
}

fn with_region(part: Part, region: Region) -> Part {
    Part { region, ..part }
}

/// Mean success in some crowds minus that in others, for one row.
fn crowds_apart(row: &'static str, higher: &[&'static str], lower: &[&'static str]) -> Part {
    Part {
        label: format!("{row}: {} − {}", higher.join(", "), lower.join(", ")),
        measure: Measure::Success,
        terms: vec![term(row, 1.0, higher), term(row, -1.0, lower)],
        region: Region::POSITIVE,
    }
}

fn claim(
    id: &'static str,
    table: &'static str,
    text: &'static str,
    reading: &'static str,
    parts: Vec<Part>,
) -> Claim {
    Claim { id, table, text, reading, parts }
}

/// All claims, in the order of the tables.
pub fn claims() -> Vec<Claim> {
    [behaviours(), agents(), intrinsic(), metrics(), deployment()].concat()
}

fn behaviours() -> Vec<Claim> {
    vec![
        claim(
            "headline",
            "Table 1",
            "With five behaviours the success rate among unseen crowds is higher than with one, on average over the crowds \
             (abstract; V-C).",
            "",
            vec![on_average("m5", "m1")],
        ),
        claim(
            "headline-each-crowd",
            "Table 1",
            "With five behaviours it is higher in every crowd (V-C: \"for all pedestrian types\").",
            "",
            in_each("m5", "m1"),
        ),
        claim(
            "diversity-each-crowd",
            "Table 1",
            "At 5,000 updates any number of behaviours above one beats one in every crowd (V-C).",
            "The paper's own M = 20 is below its M = 1 in NH and VA and equal in VO.",
            [in_each("m5", "m1"), in_each("m10", "m1"), in_each("m20", "m1")].concat(),
        ),
        claim(
            "five-is-best",
            "Table 1",
            "At 5,000 updates five behaviours are best; the effect diminishes with ten and twenty (V-C).",
            "",
            vec![on_average("m5", "m10"), on_average("m10", "m20")],
        ),
        claim(
            "more-updates",
            "Table 1",
            "With as many updates per behaviour as M = 5 had, ten and twenty behaviours get better (V-C).",
            "",
            vec![on_average("m10-long", "m10"), on_average("m20-long", "m20")],
        ),
        claim(
            "more-updates-match",
            "Table 1",
            "With as many updates per behaviour, ten and twenty behaviours match five (V-C).",
            "A match is a difference within ±0.05 of the average.",
            ["m10-long", "m20-long"]
                .map(|row| with_region(on_average(row, "m5"), Region::within(MATCH)))
                .to_vec(),
        ),
        claim(
            "non-reactive-harder",
            "Table 1",
            "Non-reactive pedestrians are the harder task (V-C, which lists NH, IN, VA, SO as non-reactive).",
            "The list contradicts the crowds' definitions and the paper's own M = 1; see the next claim.",
            ["m1", "m5"].map(|row| crowds_apart(row, &["VO", "SF"], &["NH", "IN", "VA", "SO"])).to_vec(),
        ),
        claim(
            "non-reactive-harder-as-defined",
            "Table 1",
            "Non-reactive pedestrians are the harder task (V-A, which lists IN, SO, VO, SF as non-reactive).",
            "",
            ["m1", "m5"].map(|row| crowds_apart(row, &["NH", "VA"], &["IN", "SO", "VO", "SF"])).to_vec(),
        ),
    ]
}

fn agents() -> Vec<Claim> {
    vec![
        claim(
            "agents-diversity",
            "Table 2",
            "With 5, 10 and 20 agents diversity improves the average (V-D).",
            "",
            vec![on_average("m5", "m1"), on_average("n10-m5", "n10-m1"), on_average("n20-m5", "n20-m1")],
        ),
        claim(
            "agents-diversity-each-crowd",
            "Table 2",
            "With 5, 10 and 20 agents diversity improves every crowd (V-D: \"across all pedestrian cases\").",
            "",
            [in_each("m5", "m1"), in_each("n10-m5", "n10-m1"), in_each("n20-m5", "n20-m1")].concat(),
        ),
        claim(
            "agents-harder",
            "Table 2",
            "More agents make it harder: 10 and 20 are below 5, with and without diversity (V-D).",
            "",
            vec![
                on_average("m1", "n10-m1"),
                on_average("m1", "n20-m1"),
                on_average("m5", "n10-m5"),
                on_average("m5", "n20-m5"),
            ],
        ),
    ]
}

fn intrinsic() -> Vec<Claim> {
    let d = |more, less| over(Measure::Diversity, more, less, &[]);
    vec![
        claim(
            "regularised-beats-unregularised",
            "Table 3",
            "The difference of both discriminators beats q(z | s, a) alone in every crowd (V-E).",
            "The paper's own NH is lower and its VA equal.",
            in_each("m5", "state-action"),
        ),
        claim(
            "unregularised-beats-none",
            "Table 3",
            "q(z | s, a) alone still beats no intrinsic reward (V-E).",
            "",
            vec![on_average("state-action", "m1")],
        ),
        claim(
            "difference-beats-diayn",
            "Table 3",
            "The difference of both discriminators beats q(z | s), as in DIAYN (V-E).",
            "",
            vec![on_average("m5", "state")],
        ),
        claim(
            "diversity-order",
            "Table 3",
            "D is highest for the difference, then q(z | s, a), then q(z | s), then none (V-E).",
            "D of one behaviour is 0 by definition. D grows with 1/σ², so σ stands beside it.",
            vec![
                d("m5", "state-action"),
                d("state-action", "state"),
                Part {
                    label: "state − 0".to_owned(),
                    measure: Measure::Diversity,
                    terms: vec![term("state", 1.0, &[])],
                    region: Region::POSITIVE,
                },
            ],
        ),
        claim(
            "diversity-follows-success",
            "Table 3",
            "A higher D comes with a higher success rate (V-E).",
            "Read as: the averages have the order that D has in the paper.",
            vec![
                on_average("m5", "state-action"),
                on_average("state-action", "state"),
                on_average("state", "m1"),
            ],
        ),
    ]
}

fn metrics() -> Vec<Claim> {
    let doubled = |measure| Part {
        label: format!(
            "safety-zone − 2 · m5, {}",
            if measure == Measure::ExtraTime { "extra time" } else { "extra distance" }
        ),
        measure,
        terms: vec![term("safety-zone", 1.0, &CROWDS), term("m5", -2.0, &CROWDS)],
        region: Region::POSITIVE,
    };
    let collisions = |row| Part {
        label: format!("{row}: collisions − timeouts"),
        measure: Measure::CollisionMinusTimeout,
        terms: vec![term(row, 1.0, &CROWDS)],
        region: Region::POSITIVE,
    };
    vec![
        claim(
            "fewer-collisions-without-more-time",
            "Table 4",
            "Diversity reduces collisions without additional time or travel (abstract).",
            "No additional time or travel: at most 0.2 s and 0.2 m more, on average over the crowds.",
            vec![
                less(Measure::Collision, "m5", "m1"),
                with_region(less(Measure::ExtraTime, "m5", "m1"), Region::not_below(NO_ADDITION)),
                with_region(less(Measure::ExtraDistance, "m5", "m1"), Region::not_below(NO_ADDITION)),
            ],
        ),
        claim(
            "faster-and-shorter",
            "Table 4",
            "Diversity needs less extra time and distance and is faster than the baseline (V-F).",
            "",
            vec![
                less(Measure::ExtraTime, "m5", "m1"),
                less(Measure::ExtraDistance, "m5", "m1"),
                over(Measure::AverageSpeed, "m5", "m1", &CROWDS),
            ],
        ),
        claim(
            "beats-safety-zone",
            "Table 4",
            "Diversity succeeds more often than the safety-zone policy in every crowd (V-F).",
            "Ours is a safety-zone baseline (Jin-style): the original's constants are not public.",
            in_each("m5", "safety-zone"),
        ),
        claim(
            "safety-zone-beats-baseline",
            "Table 4",
            "The safety-zone policy succeeds more often than the baseline (V-F).",
            "",
            vec![on_average("safety-zone", "m1")],
        ),
        claim(
            "safety-zone-twice-as-long",
            "Table 4",
            "The safety-zone policy needs more than twice the extra time and distance of diversity (V-F).",
            "",
            vec![doubled(Measure::ExtraTime), doubled(Measure::ExtraDistance)],
        ),
        claim(
            "collisions-not-timeouts",
            "Table 4",
            "Failures are collisions rather than timeouts (V-A, V-F).",
            "",
            ["m1", "m5", "safety-zone"].map(collisions).to_vec(),
        ),
    ]
}

fn deployment() -> Vec<Claim> {
    vec![claim(
        "deployment",
        "Table 5",
        "Diversity succeeds more often on both realistic maps (V-G).",
        "Our own maps and simulator stand for the paper's Gazebo worlds.",
        MAPS.iter().map(|map| over(Measure::Success, "m5", "m1", &[map])).collect(),
    )]
}
