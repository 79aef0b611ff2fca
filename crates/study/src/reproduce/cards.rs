//! `docs/model-cards.md`: one card for each shipped training setting, written from
//! `checkpoints/manifest.json` and the cells in `results/` (sections as in Mitchell et al. 2019,
//! *Model Cards for Model Reporting*, <https://doi.org/10.1145/3287560.3287596>).
//!
//! All numbers are read; only what a policy is for, and what it must not be used for, is written by
//! hand here.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use jostle_arena::identity::short;
use jostle_arena::{Outcome, Planner};
use jostle_eval::compact::{CompactCell, CompactEpisode};
use jostle_eval::report::grid::{Grid, number};
use jostle_eval::statistics::wilson;
use jostle_peds::CrowdKind;
use jostle_ppo::Config;
use jostle_ppo::config::NetworkInputs;
use jostle_runs::folder::sorted;

use super::plan::{POOL, STRONG};
use crate::ship::manifest::{Manifest, PolicyEntry, RunEntry};

/// The hand-written words of a card: title, use, and what its policies are not for.
struct Words {
    variant: &'static str,
    title: &'static str,
    use_for: &'static str,
    not_for: &'static str,
}

/// Settings with words of their own, in the order of the cards.
const WORDS: [Words; 5] = [
    Words {
        variant: STRONG,
        title: "strong: the policy to drive with",
        use_for: "A robot that crosses a room among people who may not make way for it, in simulation; the policy to compare a new one \
            with, and the one that the page on [ROS 2](how-to-ros2.md) drives with. It was not made to reproduce the \
            paper ([Study](study.md)).",
        not_for: "It reads bodies out of scans as round, moving things of a person's size: it has not been tested among vehicles, behind glass or \
            on slopes.",
    },
    Words {
        variant: "m1",
        title: "m1: the paper's baseline",
        use_for: "The paper's Algorithm 1 with one behaviour and no intrinsic reward: what every claim on diversity is held against.",
        not_for: "Driving: the planners below need no training and hit fewer people.",
    },
    Words {
        variant: "m5",
        title: "m5: the paper's method",
        use_for: "Five behaviours, each a token z from 0 to 4, paid for being different from one another. For studying what diversity \
            does; tables and cards drive z = 0.",
        not_for: "Driving: the planners below need no training and hit fewer people.",
    },
    Words {
        variant: "m10",
        title: "m10: ten behaviours",
        use_for: "As m5 with ten behaviours, for Table 1.",
        not_for: "Driving, and conclusions: it is one training seed.",
    },
    Words {
        variant: POOL,
        title: "pool: the pedestrians of NH, IN, VA and SO",
        use_for: "Trained as m1 from seeds of their own, they drive the learned pedestrians: those of NH, IN and VA at the end of their \
            training, those of SO at half of it. Nothing else in this project was trained with them.",
        not_for: "Training: a robot that has met them is not tested by these crowds any more.",
    },
];

/// Planners that stand beside every learned policy, as the cells name them.
const PLANNERS: [Planner; 4] = [Planner::Orca, Planner::Dwa, Planner::GoalSeeker, Planner::Straight];

/// Episodes of one robot among all six crowds, in their order.
struct Tested {
    n_agents: usize,
    crowds: Vec<Vec<CompactEpisode>>,
}

/// Tests by the SHA-256 of the robot's policy.
type Results = BTreeMap<String, Vec<Tested>>;

/// The page; `None` where nothing is shipped.
///
/// # Errors
/// A manifest or a cell that cannot be read.
pub(super) fn page(checkpoints: &Path, results: &Path) -> Result<Option<String>> {
    let Some(manifest) = Manifest::load_optional(checkpoints)? else { return Ok(None) };
    let tested = read_results(&manifest, &results.join("cells"))?;
    let mut variants: Vec<&str> = WORDS.iter().map(|words| words.variant).collect();
    for run in &manifest.runs {
        if !variants.contains(&run.variant.as_str()) {
            variants.push(&run.variant);
        }
    }
    let mut text = String::from(HEAD);
    for variant in variants {
        let runs: Vec<&RunEntry> = manifest.runs.iter().filter(|run| run.variant == variant).collect();
        if !runs.is_empty() {
            text += &card(variant, &runs, &manifest, &tested)?;
        }
    }
    Ok(Some(text))
}

const HEAD: &str = "# Model cards\n\n\
    <!-- Written by `cargo xtask reproduce page` from checkpoints/manifest.json and results/cells; edit crates/study/src/reproduce/cards.rs. -->\n\n\
    A card for each training setting whose policies are in `checkpoints/`: what it is for, how it was trained, how it does, and where it ends.\n\n\
    What holds for all of them:\n\n\
    - **Data.** None was recorded: every transition was simulated by this program from the seed that the card gives. No person's data is in \
    any policy.\n\
    - **Input and output.** An observation row of the robot ([Concepts](concepts.md)), and a velocity with a turn rate, ten times a second. \
    Which beams and which robot: the card's own.\n\
    - **Results.** Success rates with 95 % Wilson intervals over the episodes of one trained policy; episode k has the same start, goal and pedestrians for \
    every robot, planners that nobody trained among them. No policy met one of the six crowds in training. Intervals over training \
    *seeds* are in [Reproduction](reproduction.md).\n\
    - **Limits.** Tested in simulation, in one empty room of 20 m × 20 m unless a page says otherwise, among as many pedestrians as the tables name, who are as \
    wide as robots and have no legs, groups or children. A laser at one height sees no table's edge and no stairs. A success rate below 1 \
    is a collision or a standstill now and then: a robot among people needs a safety layer of its own ([ROS 2](how-to-ros2.md) has \
    one).\n\
    - **Licence.** MIT or Apache-2.0, at your option, as the code.\n";

fn card(variant: &str, runs: &[&RunEntry], manifest: &Manifest, tested: &Results) -> Result<String> {
    let policies: Vec<(&PolicyEntry, &RunEntry)> = manifest
        .policies
        .iter()
        .filter_map(|policy| Some((policy, *runs.iter().find(|run| run.name == policy.run)?)))
        .collect();
    let words = WORDS.iter().find(|words| words.variant == variant);
    let mut text = format!("\n## {}\n\n", words.map_or(variant, |words| words.title));
    if let Some(words) = words {
        writeln!(text, "**Use.** {}\n\n**Not for.** {}\n", words.use_for, words.not_for)?;
    } else {
        let rows: Vec<&str> = policies
            .first()
            .map_or(&[][..], |(policy, _)| &policy.serves[..])
            .iter()
            .map(String::as_str)
            .collect();
        writeln!(text, "**Use.** To reproduce the paper: {}.\n", rows.join("; "))?;
    }
    writeln!(text, "**Training.** {}\n", training(&runs[0].config))?;
    text += &files(&policies);
    let mut sizes: Vec<usize> = policies
        .iter()
        .filter_map(|(policy, _)| tested.get(&policy.sha256))
        .flatten()
        .map(|tested| tested.n_agents)
        .collect();
    sizes.sort_unstable();
    sizes.dedup();
    for n_agents in &sizes {
        text += &results_among(*n_agents, &policies, tested);
    }
    if sizes.is_empty() {
        text += "\n**Results.** They have not been tested as robots.\n";
    }
    Ok(text)
}

/// The setting in a paragraph, from the configuration that was trained with.
fn training(config: &Config) -> String {
    let (sim, crowd) = (&config.sim, &config.training_crowd);
    let beams = format!("{} beams over {:.0}°", sim.laser.beams, sim.laser.fov.to_degrees());
    let reads = match config.network.inputs {
        NetworkInputs::Scans if config.network.scan_pool > 1 => {
            format!("the nearest of each {} neighbouring beams", config.network.scan_pool)
        }
        NetworkInputs::Scans => "the three newest scans".to_owned(),
        NetworkInputs::Motion => "bodies with their velocities, taken from the two newest scans".to_owned(),
    };
    let shares: Vec<String> = [
        ("blind", crowd.blind),
        ("seeing", crowd.seeing),
        ("walking straight on", crowd.straight),
        ("stopping and going", crowd.stop_and_go),
        ("standing", crowd.standing),
        ("frozen policies", crowd.opponents),
    ]
    .into_iter()
    .filter(|(_, share)| *share > 0.0)
    .map(|(name, share)| format!("{:.0} % {name}", f64::from(share) * 100.0))
    .collect();
    let among = if shares.is_empty() {
        "all of them learners of the same policy".to_owned()
    } else {
        let (slow, fast) = (crowd.speed_min, crowd.speed_max);
        format!(
            "of whom {}, at {slow} to {fast} times the robot's speed; the others learn the same policy",
            shares.join(", ")
        )
    };
    let diversity = if config.n_behaviours == 1 {
        "one behaviour".to_owned()
    } else {
        format!("{} behaviours, α = {}", config.n_behaviours, config.alpha)
    };
    format!(
        "PPO (Algorithm 1), {diversity}, γ = {}, learning rate {:e}; {} rooms of {} m × {} m at a time with {} agents each, {among}. \
         The robot is {} m × {} m and drives at most {} m/s and {} rad/s; its laser has {beams}, {} m far, with noise of {} m. Reward: \
         {} at the goal, {} at a crash, {} for a metre gained. The network reads {reads}.",
        config.gamma,
        config.learning_rate,
        config.n_rooms,
        sim.room.width,
        sim.room.height,
        config.n_agents,
        sim.robot.length,
        sim.robot.width,
        sim.robot.v_max,
        sim.robot.w_max,
        sim.laser.range,
        sim.laser.noise_std,
        sim.reward.goal,
        sim.reward.collision,
        sim.reward.progress,
    )
}

/// The files with their provenance.
fn files(policies: &[(&PolicyEntry, &RunEntry)]) -> String {
    let heads = [
        "file",
        "seed",
        "updates",
        "transitions",
        "hours of training",
        "kB",
        "weights",
        "sha256",
        "config",
        "commit",
    ];
    let mut grid = Grid::new(heads);
    for (policy, run) in policies {
        let row = [
            format!("`{}`", policy.file),
            run.seed.to_string(),
            policy.updates.to_string(),
            policy.transitions.to_string(),
            format!("{:.1}", policy.wall_seconds / 3600.0),
            format!("{:.0}", policy.bytes as f64 / 1000.0),
            policy.precision.clone(),
            short(&policy.sha256).to_owned(),
            short(&run.config_hash).to_owned(),
            run.commit.clone(),
        ];
        grid.push(false, row.to_vec());
    }
    grid.markdown()
}

/// Learned policies and planners among so many agents: success by crowd, then how episodes end.
fn results_among(n_agents: usize, policies: &[(&PolicyEntry, &RunEntry)], tested: &Results) -> String {
    let crowds = CrowdKind::PAPER.each_ref().map(ToString::to_string);
    let mut rates = Grid::new(["robot".to_owned()].into_iter().chain(crowds));
    let mut ends = Grid::new([
        "robot",
        "success",
        "hit a pedestrian",
        "hit a wall",
        "timeout",
        "extra time (s)",
        "speed (m/s)",
    ]);
    let of = |sha256: &str| tested.get(sha256)?.iter().find(|tested| tested.n_agents == n_agents);
    let learned =
        policies.iter().filter_map(|(policy, _)| Some((format!("**{}**", policy.name), of(&policy.sha256)?)));
    let planners = PLANNERS.iter().filter_map(|planner| {
        Some((format!("planner {}", planner.label()), of(&planner.identity().sha256)?))
    });
    let mut n_episodes = Vec::new();
    for (name, tested) in learned.chain(planners) {
        let cells = tested.crowds.iter().map(|episodes| {
            let rate = rate(episodes.iter(), Outcome::Success);
            n_episodes.push(episodes.len());
            rate
        });
        rates.push(false, [name.clone()].into_iter().chain(cells).collect());
        let all = || tested.crowds.iter().flatten();
        let successes = || all().filter(|episode| episode.outcome == Outcome::Success);
        let mean = |value: fn(&CompactEpisode) -> Option<f64>| {
            let values: Vec<f64> = successes().filter_map(value).collect();
            number((!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64), 2)
        };
        ends.push(
            false,
            vec![
                name,
                rate(all(), Outcome::Success),
                rate(all(), Outcome::CollisionPedestrian),
                rate(all(), Outcome::CollisionWall),
                rate(all(), Outcome::Timeout),
                mean(|episode| episode.metrics.extra_time),
                mean(|episode| episode.metrics.average_speed),
            ],
        );
    }
    let (least, most) = (n_episodes.iter().min().unwrap_or(&0), n_episodes.iter().max().unwrap_or(&0));
    let episodes = if least == most { least.to_string() } else { format!("{least} to {most}") };
    format!(
        "\n**Results among {} pedestrians**, {episodes} episodes a crowd:\n\n{}\nAll six crowds together; time and speed over the \
         successes:\n\n{}",
        n_agents - 1,
        rates.markdown(),
        ends.markdown()
    )
}

/// The share of episodes with an outcome, with its interval.
fn rate<'a>(episodes: impl Iterator<Item = &'a CompactEpisode>, outcome: Outcome) -> String {
    let (mut n, mut hits) = (0, 0);
    for episode in episodes {
        n += 1;
        hits += u64::from(episode.outcome == outcome);
    }
    wilson(hits, n).map_or_else(
        || "–".to_owned(),
        |ends| format!("{:.3} ({:.3} to {:.3})", hits as f64 / n as f64, ends.low, ends.high),
    )
}

/// The cells of robots among all six crowds, with token 0 and shipped pedestrians; where a robot
/// was tested in several such settings, the first by its hash.
fn read_results(manifest: &Manifest, folder: &Path) -> Result<Results> {
    let mut cells: BTreeMap<(String, usize, String), BTreeMap<String, CompactCell>> = BTreeMap::new();
    if !folder.is_dir() {
        return Ok(Results::new());
    }
    for path in sorted(folder)?.iter().filter(|path| path.extension().is_some_and(|end| end == "txt")) {
        let cell = CompactCell::read(path)?;
        let key = &cell.head.key;
        let shipped = |sha256: &String| manifest.policies.iter().any(|policy| policy.sha256 == *sha256);
        if key.token == 0 && key.seed == 0 && key.pool.iter().all(shipped) {
            let setting = (key.policy.clone(), key.n_agents, key.settings.clone());
            cells.entry(setting).or_default().insert(key.crowd.to_string(), cell);
        }
    }
    let mut results = Results::new();
    for ((sha256, n_agents, _), mut of_crowds) in cells {
        let crowds: Option<Vec<CompactCell>> =
            CrowdKind::PAPER.iter().map(|crowd| of_crowds.remove(&crowd.to_string())).collect();
        let Some(crowds) = crowds else { continue };
        let known = results.entry(sha256).or_default();
        if known.iter().all(|tested: &Tested| tested.n_agents != n_agents) {
            let crowds = crowds.iter().map(|cell| cell.episodes(cell.head.episodes as usize)).collect();
            known.push(Tested { n_agents, crowds });
        }
    }
    Ok(results)
}

#[cfg(test)]
mod tests {
    use jostle_runs::provenance::workspace;

    use super::*;
    use crate::reproduce::page::CARDS;

    #[test]
    fn the_cards_are_what_manifest_and_results_say() {
        let (checkpoints, results) = (workspace().join("checkpoints"), workspace().join("results"));
        let expected = page(&checkpoints, &results).unwrap().expect("policies are shipped");
        let found = std::fs::read_to_string(workspace().join(CARDS)).unwrap();
        assert!(
            found == expected,
            "{CARDS}: run `cargo xtask reproduce page`: checkpoints/ or results/ have changed"
        );
        let manifest = Manifest::load(&checkpoints).unwrap();
        for policy in &manifest.policies {
            let lines = found.lines().filter(|line| line.contains(&format!("`{}`", policy.file)));
            assert_eq!(lines.count(), 1, "{}: expected one line with its provenance", policy.name);
        }
    }

    #[test]
    fn a_planner_stands_beside_every_policy_that_was_tested() {
        let (checkpoints, results) = (workspace().join("checkpoints"), workspace().join("results"));
        let text = page(&checkpoints, &results).unwrap().unwrap();
        for block in text.split("**Results among ").skip(1) {
            assert!(
                block.contains("| planner dwa |") && block.contains("| planner orca (knows positions) |"),
                "{block}"
            );
        }
        assert!(text.contains("They have not been tested as robots."), "the pool is not tested");
    }
}
