//! Reads the recorded RVO2 runs: `NAME.csv` (states) and `NAME_lines.csv` (half-planes).

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};

/// A recorded run.
pub(crate) struct Recording {
    pub(crate) parameters: Parameters,
    pub(crate) goals: Vec<[f32; 2]>,
    pub(crate) obstacles: Vec<Vec<[f32; 2]>>,
    /// `states[step][agent]`; step 0 is the start.
    pub(crate) states: Vec<Vec<State>>,
    /// True where the preferred velocities carry a random part and must be read from the file.
    pub(crate) perturbed: bool,
}

/// The `params` line, shared by all agents.
#[derive(Default)]
pub(crate) struct Parameters {
    pub(crate) time_step: f32,
    pub(crate) neighbor_dist: f32,
    pub(crate) max_neighbors: usize,
    pub(crate) time_horizon: f32,
    pub(crate) time_horizon_obst: f32,
    pub(crate) radius: f32,
    pub(crate) max_speed: f32,
}

/// One row: what holds after the step, and the preferred velocity that was passed to it.
#[derive(Clone, Copy)]
pub(crate) struct State {
    pub(crate) position: [f32; 2],
    pub(crate) velocity: [f32; 2],
    pub(crate) preferred: [f32; 2],
}

/// One recorded half-plane.
#[derive(Clone, Copy)]
pub(crate) struct Line {
    pub(crate) point: [f32; 2],
    pub(crate) direction: [f32; 2],
}

/// The half-planes of one agent in one step, obstacle lines first.
#[derive(Clone, Default)]
pub(crate) struct Lines {
    pub(crate) lines: Vec<Line>,
    pub(crate) n_agent_lines: usize,
}

impl Recording {
    /// Reads a recorded run.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        Self::parse(&std::fs::read_to_string(path).context("cannot be read")?)
    }

    fn parse(text: &str) -> Result<Self> {
        let mut head = Head::default();
        let mut states: Vec<Vec<State>> = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let place = || format!("line {}: {line}", number + 1);
            if let Some(comment) = line.strip_prefix('#') {
                head.comment(comment.trim()).with_context(place)?;
            } else if !line.starts_with("step,") && !line.trim().is_empty() {
                row(line, head.agents.len(), &mut states).with_context(place)?;
            }
        }
        let parameters = head.parameters.context("no `params` line")?;
        ensure!(states.len() >= 2, "no recorded step");
        ensure!(states.iter().all(|s| s.len() == head.agents.len()), "a step does not hold every agent");
        Ok(Self {
            parameters,
            goals: head.agents,
            obstacles: head.obstacles,
            states,
            perturbed: head.perturbed,
        })
    }
}

#[derive(Default)]
struct Head {
    parameters: Option<Parameters>,
    agents: Vec<[f32; 2]>,
    obstacles: Vec<Vec<[f32; 2]>>,
    perturbed: bool,
}

impl Head {
    fn comment(&mut self, comment: &str) -> Result<()> {
        if let Some(rest) = comment.strip_prefix("params:") {
            self.parameters = Some(parameters(rest)?);
        } else if let Some(rule) = comment.strip_prefix("prefvel rule:") {
            self.perturbed = rule.contains("perturbation");
        } else if let Some(rest) = numbered(comment, "agent ") {
            let goal =
                rest.split_whitespace().find_map(|word| word.strip_prefix("goal=")).context("no goal")?;
            self.agents.push(point(goal)?);
        } else if let Some(vertices) = numbered(comment, "obstacle ") {
            self.obstacles.push(vertices.split_whitespace().map(point).collect::<Result<_>>()?);
        }
        Ok(())
    }
}

/// The text behind `word` and a number with a colon; descriptions that merely begin with the word
/// are none of ours.
fn numbered<'a>(comment: &'a str, word: &str) -> Option<&'a str> {
    let (number, rest) = comment.strip_prefix(word)?.split_once(':')?;
    number.parse::<usize>().ok().map(|_| rest)
}

fn parameters(text: &str) -> Result<Parameters> {
    let value = |key: &str| -> Result<f32> {
        let word = text.split_whitespace().find_map(|word| word.strip_prefix(key)?.strip_prefix('='));
        Ok(word.with_context(|| format!("no {key}"))?.parse()?)
    };
    Ok(Parameters {
        time_step: value("timeStep")?,
        neighbor_dist: value("neighborDist")?,
        max_neighbors: value("maxNeighbors")? as usize,
        time_horizon: value("timeHorizon")?,
        time_horizon_obst: value("timeHorizonObst")?,
        radius: value("radius")?,
        max_speed: value("maxSpeed")?,
    })
}

fn point(text: &str) -> Result<[f32; 2]> {
    let (x, y) = text.split_once(',').context("no point x,y")?;
    Ok([x.parse()?, y.parse()?])
}

fn row(line: &str, n_agents: usize, states: &mut Vec<Vec<State>>) -> Result<()> {
    let fields: Vec<&str> = line.split(',').collect();
    ensure!(fields.len() == 8, "{} fields, not 8", fields.len());
    let (step, agent): (usize, usize) = (fields[0].parse()?, fields[1].parse()?);
    let number = |index: usize| -> Result<f32> { Ok(fields[index].parse::<f32>()?) };
    if agent == 0 {
        states.push(Vec::with_capacity(n_agents));
    }
    let n_steps = states.len();
    let Some(current) =
        states.last_mut().filter(|s| step + 1 == n_steps && s.len() == agent && agent < n_agents)
    else {
        bail!("rows are not sorted by step, then agent");
    };
    current.push(State {
        position: [number(2)?, number(3)?],
        velocity: [number(4)?, number(5)?],
        preferred: [number(6)?, number(7)?],
    });
    Ok(())
}

/// Reads the half-planes of a run with `n_steps` steps and `n_agents` agents: `[step − 1][agent]`.
///
/// A file of the first steps only says how many they are in a comment, `steps=12`; any other has
/// all of the run's. An agent without lines in a step has no row. Values may be `nan` or `-nan`.
pub(crate) fn read_lines(path: &Path, n_steps: usize, n_agents: usize) -> Result<Vec<Vec<Lines>>> {
    parse_lines(&std::fs::read_to_string(path).context("cannot be read")?, n_steps, n_agents)
}

fn parse_lines(text: &str, n_steps: usize, n_agents: usize) -> Result<Vec<Vec<Lines>>> {
    let mut comments = text.lines().filter_map(|line| line.strip_prefix('#'));
    let recorded =
        comments.find_map(|comment| comment.split_whitespace().find_map(|w| w.strip_prefix("steps=")));
    let n_recorded = match recorded {
        Some(number) => number.parse().with_context(|| format!("steps={number} is no number of steps"))?,
        None => n_steps,
    };
    ensure!((1..=n_steps).contains(&n_recorded), "half-planes of {n_recorded} steps, the run has {n_steps}");
    let mut all = vec![vec![Lines::default(); n_agents]; n_recorded];
    for (number, line) in text.lines().enumerate() {
        if !(line.starts_with('#') || line.starts_with("step,") || line.trim().is_empty()) {
            line_row(line, &mut all).with_context(|| format!("line {}: {line}", number + 1))?;
        }
    }
    Ok(all)
}

fn line_row(line: &str, all: &mut [Vec<Lines>]) -> Result<()> {
    let fields: Vec<&str> = line.split(',').collect();
    ensure!(fields.len() == 8, "{} fields, not 8", fields.len());
    let (step, agent): (usize, usize) = (fields[0].parse()?, fields[1].parse()?);
    let index: usize = fields[2].parse()?;
    let number = |index: usize| -> Result<f32> { Ok(fields[index].parse::<f32>()?) };
    let of_step =
        step.checked_sub(1).and_then(|step| all.get_mut(step)).context("a step that was not recorded")?;
    let entry = of_step.get_mut(agent).context("an agent that the run does not have")?;
    ensure!(index == entry.lines.len(), "half-planes are not in order");
    entry.n_agent_lines = fields[3].parse()?;
    entry.lines.push(Line { point: [number(4)?, number(5)?], direction: [number(6)?, number(7)?] });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{Lines, Recording, line_row, parse_lines};

    #[test]
    fn half_planes_are_those_of_the_whole_run_unless_a_comment_says_otherwise() {
        let rows = "step,agent,line,n_agent_lines,px,py,dx,dy\n1,0,0,1,2,0,0,1\n";
        assert_eq!(parse_lines(rows, 3, 2).unwrap().len(), 3);
        assert_eq!(parse_lines(&format!("# of the start; steps=2\n{rows}"), 3, 2).unwrap().len(), 2);
        for wrong in ["steps=4", "steps=0", "steps=x"] {
            assert!(parse_lines(&format!("# {wrong}\n{rows}"), 3, 2).is_err(), "{wrong}");
        }
        assert!(parse_lines(&format!("# steps=1\n{rows}2,0,0,1,2,0,0,1\n"), 3, 2).is_err());
    }

    #[test]
    fn head_and_rows_are_read() {
        let text = "# params: timeStep=0.25 neighborDist=15 maxNeighbors=10 timeHorizon=10 timeHorizonObst=9 \
                    radius=1.5 maxSpeed=2 steps=1 agents=1\n# agent walks at a wall\n# agent 0: pos=1,2 vel=0,0 goal=-3,4e-1\n\
                    # obstacle 0: -10,40 -40,40 -40,10\nstep,agent,px,py,vx,vy,pvx,pvy\n0,0,1,2,0,0,0,0\n1,0,1,2,3,4,5,6\n";
        let recording = Recording::parse(text).unwrap();
        assert_eq!(recording.parameters.time_horizon, 10.0);
        assert_eq!(recording.parameters.time_horizon_obst, 9.0);
        assert_eq!(recording.goals, [[-3.0, 0.4]]);
        assert_eq!(recording.obstacles[0].len(), 3);
        assert_eq!(recording.states[1][0].preferred, [5.0, 6.0]);
        assert!(Recording::parse(&text.replace("1,0,1,2", "2,0,1,2")).is_err());
        assert!(Recording::parse("").is_err());
    }

    #[test]
    fn both_spellings_of_nan_are_read() {
        let mut all = vec![vec![Lines::default()]];
        line_row("1,0,0,1,-nan,nan,-0.5,1", &mut all).unwrap();
        let line = all[0][0].lines[0];
        assert!(line.point[0].is_nan() && line.point[1].is_nan());
        assert_eq!(line.direction, [-0.5, 1.0]);
    }
}
