//! The shipped part of a training curve: its first updates to the byte, and all of it in means over
//! windows.

use anyhow::{Context as _, Result, ensure};
use jostle_eval::report::grid::csv_line;
use jostle_ppo::report::{DiscriminatorReport, EpisodeCounts};
use jostle_ppo::{Clock, UpdateReport};
use serde_json::Value;

/// Updates that are shipped to the byte.
pub(crate) const FIRST: usize = 50;
/// Most windows of the whole curve.
const WINDOWS: usize = 200;

/// The line of an update report without its clock, which is its last field.
///
/// # Errors
/// A line that is no update report.
pub(crate) fn without_clock(line: &str) -> Result<String> {
    let at = line.rfind(",\"clock\":{").context("a line of the log has no clock")?;
    let kept = format!("{}}}", &line[..at]);
    let read: Result<Value, _> = serde_json::from_str(&kept);
    ensure!(
        read.is_ok_and(|value| value.is_object()),
        "the clock is not the last field of a line of the log"
    );
    Ok(kept)
}

/// The field in which two reports without clock first differ, in the order of their names; `None`
/// where they are equal. Fields that the program has got since the first was written do not count.
pub(crate) fn first_difference(shipped: &str, now: &str) -> Result<Option<String>> {
    if shipped == now {
        return Ok(None);
    }
    let [shipped, now] = [shipped, now].map(serde_json::from_str::<Value>);
    let (shipped, now) = (shipped.context("a shipped line is no JSON")?, now.context("a report is no JSON")?);
    Ok(difference("", &shipped, &now))
}

fn difference(path: &str, shipped: &Value, now: &Value) -> Option<String> {
    if let (Value::Object(shipped), Value::Object(now)) = (shipped, now) {
        return shipped.iter().find_map(|(key, value)| {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            difference(&path, value, now.get(key).unwrap_or(&Value::Null))
        });
    }
    // As text: 0 and −0 are equal numbers and other bytes.
    let [shipped, now] = [shipped, now].map(Value::to_string);
    (shipped != now).then(|| format!("{path}: shipped {shipped}, now {now}"))
}

/// A mean over the updates of a window.
type Column = (&'static str, fn(&UpdateReport) -> f64);

const COLUMNS: [Column; 16] = [
    ("task_reward", |r| r.task_reward),
    ("intrinsic_reward", |r| r.intrinsic_reward),
    ("loss_state_action", |r| r.discriminator_state_action.loss),
    ("accuracy_state_action", |r| r.discriminator_state_action.accuracy),
    ("loss_state", |r| r.discriminator_state.loss),
    ("accuracy_state", |r| r.discriminator_state.accuracy),
    ("diversity", |r| r.diversity),
    ("value_loss", |r| r.value_loss),
    ("explained_variance", |r| r.explained_variance),
    ("policy_loss", |r| r.policy_loss),
    ("approx_kl", |r| r.approx_kl),
    ("clip_fraction", |r| r.clip_fraction),
    ("entropy", |r| r.entropy),
    ("log_std_v", |r| f64::from(r.log_std[0])),
    ("log_std_w", |r| f64::from(r.log_std[1])),
    ("seconds", |r| r.clock.total),
];

/// The whole curve as CSV: a line for each window with its last update, counts of episodes and
/// means of the rest.
pub(crate) fn windows(reports: &[UpdateReport]) -> String {
    let width = reports.len().div_ceil(WINDOWS).max(1);
    let heads = ["update", "updates", "ended", "success", "collision_wall", "collision_agent", "timeout"];
    let mut text = csv_line(heads.into_iter().chain(COLUMNS.iter().map(|(name, _)| *name)));
    for window in reports.chunks(width) {
        let count = |get: fn(&UpdateReport) -> u64| window.iter().map(get).sum::<u64>().to_string();
        let mut fields = vec![
            window.last().map_or(0, |report| report.update).to_string(),
            window.len().to_string(),
            count(|r| r.episodes.ended),
            count(|r| r.episodes.success),
            count(|r| r.episodes.collision_wall),
            count(|r| r.episodes.collision_agent),
            count(|r| r.episodes.timeout),
        ];
        let mean = |get: fn(&UpdateReport) -> f64| window.iter().map(get).sum::<f64>() / window.len() as f64;
        // Six significant digits are more than a picture shows.
        fields.extend(COLUMNS.iter().map(|(_, get)| format!("{:.5e}", mean(*get))));
        text += &csv_line(fields);
    }
    text
}

/// A curve as update reports again: what [`windows`] wrote, each window as so many reports of its
/// means, its episodes in the last of them. Sums and means over whole windows are the run's own, to
/// six digits; nothing within a window is. What a curve does not hold is `None` or 0.
///
/// # Errors
/// A text that is no curve: names the line and the column.
pub(crate) fn reports(text: &str, transitions_of_update: u64) -> Result<Vec<UpdateReport>> {
    let mut lines = text.lines();
    let heads: Vec<&str> =
        lines.next().context("found nothing, expected a line of columns")?.split(',').collect();
    let mut reports = Vec::new();
    for (index, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        let field = |name: &str| {
            let at = heads.iter().position(|head| *head == name);
            at.and_then(|at| fields.get(at).copied())
                .with_context(|| format!("line {}: column {name}: found nothing", index + 2))
        };
        let number = |name: &str| -> Result<f64> {
            let found = field(name)?;
            let bad = || format!("line {}: column {name}: found {found}, expected a number", index + 2);
            found.parse().with_context(bad)
        };
        let count = |name: &str| -> Result<u64> {
            let found = field(name)?;
            let bad = || format!("line {}: column {name}: found {found}, expected a count", index + 2);
            found.parse().with_context(bad)
        };
        let (last, updates) = (count("update")?, count("updates")?);
        let end = reports.len() as u64 + updates;
        ensure!(
            updates > 0 && last == end,
            "line {}: column update: found {last}, expected {end}",
            index + 2
        );
        let discriminator = |loss, accuracy| -> Result<DiscriminatorReport> {
            Ok(DiscriminatorReport { loss: number(loss)?, accuracy: number(accuracy)? })
        };
        let means = UpdateReport {
            update: 0,
            transitions: 0,
            task_reward: number("task_reward")?,
            intrinsic_reward: number("intrinsic_reward")?,
            episodes: EpisodeCounts::default(),
            episode_return: None,
            episode_length: None,
            discriminator_state_action: discriminator("loss_state_action", "accuracy_state_action")?,
            discriminator_state: discriminator("loss_state", "accuracy_state")?,
            diversity: number("diversity")?,
            value_loss: number("value_loss")?,
            explained_variance: number("explained_variance")?,
            policy_loss: number("policy_loss")?,
            approx_kl: number("approx_kl")?,
            clip_fraction: number("clip_fraction")?,
            first_ratio_deviation: 0.0,
            entropy: number("entropy")?,
            log_std: [number("log_std_v")? as f32, number("log_std_w")? as f32],
            paid_behaviours: None,
            crowd: None,
            clock: Clock { total: number("seconds")?, ..Clock::default() },
        };
        for update in last - updates + 1..=last {
            reports.push(UpdateReport {
                update,
                transitions: update * transitions_of_update,
                ..means.clone()
            });
        }
        let episodes = EpisodeCounts {
            ended: count("ended")?,
            success: count("success")?,
            collision_wall: count("collision_wall")?,
            collision_agent: count("collision_agent")?,
            timeout: count("timeout")?,
        };
        reports.last_mut().expect("a window has updates").episodes = episodes;
    }
    Ok(reports)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_reads_back_as_it_was_written() {
        let head = "update,updates,ended,success,collision_wall,collision_agent,timeout,task_reward,intrinsic_reward,\
            loss_state_action,accuracy_state_action,loss_state,accuracy_state,diversity,value_loss,explained_variance,\
            policy_loss,approx_kl,clip_fraction,entropy,log_std_v,log_std_w,seconds";
        let line =
            |update: usize, first: &str| format!("{update},1,3,1,1,0,1,{first}{}", ",2.50000e-1".repeat(15));
        let text = format!("{head}\n{}\n{}\n", line(1, "1.00000e0"), line(2, "-5.00000e-1"));
        let read = reports(&text, 640).unwrap();
        assert_eq!((read.len(), read[1].transitions, read[1].task_reward), (2, 1280, -0.5));
        assert_eq!((read[0].episodes.ended, read[0].diversity, read[0].log_std), (3, 0.25, [0.25; 2]));
        assert_eq!(windows(&read), text);

        let wide = text.lines().next().unwrap().to_owned()
            + "\n"
            + &line(25, "1.00000e0").replace("25,1,", "25,25,");
        let read = reports(&wide, 640).unwrap();
        assert_eq!(read.len(), 25);
        assert_eq!(read.iter().map(|report| report.episodes.ended).sum::<u64>(), 3);
        assert!(read.iter().all(|report| report.task_reward == 1.0));

        let refused = |from: &str, to: &str, named: &str| {
            let error = format!("{:#}", reports(&text.replacen(from, to, 1), 640).unwrap_err());
            assert!(error.contains(named), "{error}");
        };
        refused("diversity", "other", "line 2: column diversity: found nothing");
        refused("1.00000e0", "many", "line 2: column task_reward: found many, expected a number");
        refused("\n2,1,", "\n3,1,", "line 3: column update: found 3, expected 2");
    }

    #[test]
    fn the_clock_alone_is_cut_off() {
        assert_eq!(without_clock("{\"a\":1.50,\"clock\":{\"x\":2}}").unwrap(), "{\"a\":1.50}");
        assert!(without_clock("{\"a\":1}").is_err());
        assert!(without_clock("{\"a\":{\"b\":1,\"clock\":{}}}").is_err());
    }

    #[test]
    fn the_first_difference_is_named_and_new_fields_do_not_count() {
        let check = |now: &str, expected: Option<&str>| {
            let shipped = "{\"a\":1,\"b\":{\"c\":0.1,\"d\":2}}";
            assert_eq!(first_difference(shipped, now).unwrap().as_deref(), expected);
        };
        check("{\"a\":1,\"b\":{\"c\":0.1,\"d\":2}}", None);
        check("{\"a\":1,\"b\":{\"c\":0.1,\"d\":2},\"e\":5}", None);
        check(
            "{\"a\":1,\"b\":{\"c\":0.10000000000000002,\"d\":2}}",
            Some("b.c: shipped 0.1, now 0.10000000000000002"),
        );
        check("{\"a\":1,\"b\":{\"c\":0.1}}", Some("b.d: shipped 2, now null"));
    }
}
