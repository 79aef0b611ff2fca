//! Tells what a file is by what stands in it, so that fixtures may carry any name.

use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::Value;

use super::tensors::Tensors;

/// The content of a file.
pub(crate) enum Kind {
    Forward(Tensors),
    Ppo(Tensors),
    Discriminator(Tensors),
    Gae(Value),
    Kl(Value),
    Lidar(Value),
    Forces(Value),
    Trajectories(Value),
    Episodes(Value),
    Intervals(Value),
    Rvo2,
    Rvo2Lines,
    /// Words about the fixtures: nothing to check.
    Informational,
    Unknown,
}

/// Reads as much of a file as it takes to know its kind.
///
/// # Errors
/// When the file cannot be read, or is not of the format that its ending promises.
pub(crate) fn detect(path: &Path) -> Result<Kind> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    if name.starts_with("README") || name == "SHA256SUMS" || name == "deviations.json" {
        return Ok(Kind::Informational);
    }
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("safetensors") => Ok(of_tensors(Tensors::read(path)?)),
        Some("json") => {
            let text = std::fs::read_to_string(path).context("cannot be read")?;
            Ok(of_json(serde_json::from_str(&text).context("is no JSON")?))
        }
        Some("csv") => Ok(of_csv(&std::fs::read_to_string(path).context("cannot be read")?)),
        _ => Ok(Kind::Unknown),
    }
}

fn of_tensors(tensors: Tensors) -> Kind {
    let has_gradients =
        tensors.names_under("grad.actor.").next().or(tensors.names_under("grad.critic.").next()).is_some();
    let has_q = ["state.out.weight", "state_action.out.weight"].iter().any(|name| tensors.has(name));
    if has_gradients || tensors.has("value_target") {
        Kind::Ppo(tensors)
    } else if has_q {
        Kind::Discriminator(tensors)
    } else if tensors.has("actor.fc1.weight") || tensors.has("critic.fc1.weight") {
        Kind::Forward(tensors)
    } else {
        Kind::Unknown
    }
}

fn of_json(json: Value) -> Kind {
    let case = |key: &str| json["cases"].get(0).is_some_and(|case| case.get(key).is_some());
    if case("gamma") {
        Kind::Gae(json)
    } else if case("pairwise") {
        Kind::Kl(json)
    } else if json["scenes"].is_array() {
        Kind::Lidar(json)
    } else if json["states"].is_array() {
        Kind::Forces(json)
    } else if case("trajectories") {
        Kind::Trajectories(json)
    } else if case("episodes") {
        Kind::Episodes(json)
    } else if ["wilson", "mcnemar", "paired"].iter().any(|key| json[key].is_array()) {
        Kind::Intervals(json)
    } else {
        Kind::Unknown
    }
}

fn of_csv(text: &str) -> Kind {
    let header = text.lines().find(|line| line.starts_with("step,"));
    match header.map(str::trim) {
        Some("step,agent,px,py,vx,vy,pvx,pvy") => Kind::Rvo2,
        Some("step,agent,line,n_agent_lines,px,py,dx,dy") => Kind::Rvo2Lines,
        _ => Kind::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::{Kind, of_csv, of_json};

    #[test]
    fn json_is_known_by_its_keys() {
        let json = |text: &str| of_json(serde_json::from_str(text).unwrap());
        assert!(matches!(json(r#"{"cases":[{"gamma":1}]}"#), Kind::Gae(_)));
        assert!(matches!(json(r#"{"cases":[{"pairwise":[]}]}"#), Kind::Kl(_)));
        assert!(matches!(json(r#"{"cases":[]}"#), Kind::Unknown));
        assert!(matches!(json(r#"{"mcnemar":[]}"#), Kind::Intervals(_)));
        assert!(matches!(json("[1]"), Kind::Unknown));
    }

    #[test]
    fn csv_is_known_by_its_header() {
        assert!(matches!(of_csv("# x\nstep,agent,px,py,vx,vy,pvx,pvy\n"), Kind::Rvo2));
        assert!(matches!(of_csv("a,b\n"), Kind::Unknown));
    }
}
