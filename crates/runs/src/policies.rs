//! The search for policies: a checkpoint file, a run folder, or a folder of either; and other
//! drivers of the robot.

use std::path::{Path, PathBuf};

use jostle_arena::{Driver, LoadedPolicy, Planner, Pools};
use jostle_peds::CrowdKind;
use jostle_policy::{nearest, offer};

use crate::error::RunsError;
use crate::folder::{checkpoint_path, is_run_folder, latest_checkpoint, run_of, sorted};

/// Folders in which a name without a folder is looked for when nothing of that name is here, to
/// offer what was meant.
const USUAL: [&str; 2] = ["runs", "checkpoints"];

/// The checkpoint that a path means: the file itself, or a run's newest.
///
/// # Errors
///
/// As [`checkpoint_or`].
pub fn checkpoint(path: &Path) -> Result<PathBuf, RunsError> {
    checkpoint_or(path, "a checkpoint file or a run folder", &[])
}

/// As [`checkpoint`], where names could stand instead of a path: a path that leads nowhere is
/// answered with the nearest of `names` and of the checkpoints and runs beside it. `expected` says
/// what could stand there.
///
/// # Errors
///
/// Nothing there; a folder that is no run's; a run without a finished checkpoint.
pub fn checkpoint_or(path: &Path, expected: &'static str, names: &[&str]) -> Result<PathBuf, RunsError> {
    if is_run_folder(path) {
        return latest_checkpoint(path);
    }
    if path.is_dir() {
        return Err(RunsError::NoRun { path: path.to_owned() });
    }
    if !path.exists() {
        return Err(RunsError::Missing { path: path.to_owned(), expected, hint: hint(path, names) });
    }
    Ok(path.to_owned())
}

/// The driver of the robot: a planner by its name, or the checkpoint that a path means. `dwa` is
/// the planner whatever lies here, `./dwa` a path.
///
/// # Errors
///
/// As [`checkpoint_or`] and [`load`].
pub fn driver(path: &Path) -> Result<Driver, RunsError> {
    let names = Planner::ALL.map(Planner::name);
    if let Some(planner) = Planner::ALL.into_iter().find(|planner| path.as_os_str() == planner.name()) {
        return Ok(Driver::Planner(planner));
    }
    let expected = "a checkpoint file, a run folder or a planner's name";
    Ok(Driver::Trained(Box::new(load(&checkpoint_or(path, expected, &names)?)?)))
}

/// Reads a checkpoint; a run's is called by its folder, as the file's own name is only a count of
/// updates.
///
/// # Errors
///
/// As [`LoadedPolicy::load`].
pub fn load(path: &Path) -> Result<LoadedPolicy, RunsError> {
    let mut policy = LoadedPolicy::load(path)?;
    if let Some(name) = run_of(path).and_then(Path::file_name) {
        policy.identity.name = name.to_string_lossy().into_owned();
    }
    Ok(policy)
}

/// The checkpoints of a pool: each path is a file, a run folder, or a folder of files or run
/// folders (taken in the order of their names).
///
/// # Errors
///
/// As [`checkpoint`]; a folder without a policy.
pub fn pool(paths: &[PathBuf]) -> Result<Vec<PathBuf>, RunsError> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() && !is_run_folder(path) {
            let before = found.len();
            for entry in sorted(path)?.iter().filter(|entry| is_policy(entry)) {
                found.push(checkpoint(entry)?);
            }
            if found.len() == before {
                return Err(RunsError::EmptyFolder { path: path.clone() });
            }
        } else {
            found.push(checkpoint(path)?);
        }
    }
    Ok(found)
}

/// The same policies at half their training, where the runs that they belong to have kept that
/// checkpoint. `option` is what names half-trained policies where this is called from.
///
/// # Errors
///
/// A file that is no run's checkpoint; a run that did not keep the checkpoint.
pub fn half_trained(pool: &[PathBuf], option: &'static str) -> Result<Vec<PathBuf>, RunsError> {
    let half = |path: &PathBuf| -> Result<PathBuf, RunsError> {
        let update: Option<u64> = path.file_stem().and_then(|stem| stem.to_str()?.parse().ok());
        let Some((run, update)) = run_of(path).zip(update) else {
            return Err(RunsError::NoRunToHalve { path: path.clone(), option });
        };
        let half = checkpoint_path(run, update / 2);
        if half.is_file() { Ok(half) } else { Err(RunsError::NoHalf { path: half, option }) }
    };
    pool.iter().map(half).collect()
}

/// The pedestrians' policies, as far as the crowds ask for them: SO takes `half`, or the pool's own
/// half-trained checkpoints.
///
/// # Errors
///
/// As [`pool`], [`half_trained`] and [`load`].
pub fn pools(
    full: &[PathBuf],
    half: &[PathBuf],
    crowds: &[CrowdKind],
    option: &'static str,
) -> Result<Pools, RunsError> {
    let load_all =
        |paths: Vec<PathBuf>| paths.iter().map(|path| load(path)).collect::<Result<Vec<LoadedPolicy>, _>>();
    let full = pool(full)?;
    let half = if !half.is_empty() {
        pool(half)?
    } else if crowds.contains(&CrowdKind::So) {
        half_trained(&full, option)?
    } else {
        Vec::new()
    };
    Ok(Pools { full: load_all(full)?, half: load_all(half)? })
}

/// True if a path may hold a policy, judged by its name and what is in it.
fn is_policy(path: &Path) -> bool {
    is_run_folder(path) || path.extension().is_some_and(|extension| extension == "safetensors")
}

/// The nearest names to a path that leads nowhere: of `names`, and of the checkpoints and runs in
/// its folder (for a name without a folder, in the usual ones as well).
fn hint(path: &Path, names: &[&str]) -> String {
    let Some(wanted) = stem(path) else { return String::new() };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folders = folder.map_or_else(
        || [".", USUAL[0], USUAL[1]].iter().map(PathBuf::from).collect(),
        |folder| vec![folder.to_owned()],
    );
    let mut known: Vec<(String, String)> =
        names.iter().map(|name| ((*name).into(), (*name).into())).collect();
    for folder in folders {
        // A folder that cannot be listed has nothing to offer; the error at hand is the one to
        // report.
        for entry in sorted(&folder).unwrap_or_default().iter().filter(|entry| is_policy(entry)) {
            let shown = entry.strip_prefix(".").unwrap_or(entry).display().to_string();
            known.extend(stem(entry).map(|stem| (stem, shown)));
        }
    }
    let similar = nearest(&wanted, known.iter().map(|(name, _)| name.as_str()));
    let shown = similar.iter().filter_map(|name| Some(&*known.iter().find(|(known, _)| known == name)?.1));
    offer(&shown.collect::<Vec<_>>())
}

/// The part of a path that tells it from its siblings: its last part, without the ending that all
/// checkpoints have.
fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    Some(name.strip_suffix(".safetensors").unwrap_or(name).to_owned())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A run folder with checkpoints after the given updates, the last of them the newest.
    fn run(folder: &Path, updates: &[u64]) -> PathBuf {
        fs::create_dir_all(folder.join("checkpoints")).unwrap();
        fs::write(folder.join("config.toml"), "").unwrap();
        for update in updates {
            fs::write(checkpoint_path(folder, *update), "").unwrap();
            fs::write(folder.join("latest"), format!("{update:06}.safetensors\n")).unwrap();
        }
        folder.to_owned()
    }

    fn line<T: std::fmt::Debug>(answer: Result<T, RunsError>) -> String {
        let error = answer.unwrap_err();
        assert!(std::error::Error::source(&error).is_none(), "{error:?}");
        error.to_string()
    }

    #[test]
    fn a_path_means_itself_or_a_runs_newest() {
        let folder = tempfile::tempdir().unwrap();
        let ours = run(&folder.path().join("ours"), &[5, 10]);
        assert_eq!(checkpoint(&ours).unwrap(), checkpoint_path(&ours, 10));
        assert_eq!(checkpoint(&checkpoint_path(&ours, 5)).unwrap(), checkpoint_path(&ours, 5));
        assert!(line(checkpoint(folder.path())).contains("is no run folder"));
        let young = run(&folder.path().join("young"), &[]);
        assert!(line(checkpoint(&young)).ends_with("holds no finished checkpoint (no file `latest`)"));
    }

    #[test]
    fn a_pool_is_files_runs_and_folders_of_either() {
        let folder = tempfile::tempdir().unwrap();
        let pools = folder.path().join("pool");
        let (b, a) = (run(&pools.join("b"), &[4]), run(&pools.join("a"), &[2, 4]));
        let file = pools.join("c.safetensors");
        fs::write(&file, "").unwrap();
        fs::write(pools.join("notes.txt"), "").unwrap();
        let all = [checkpoint_path(&a, 4), checkpoint_path(&b, 4), file.clone()];
        assert_eq!(pool(std::slice::from_ref(&pools)).unwrap(), all);
        assert_eq!(pool(&[file.clone(), a.clone()]).unwrap(), [file, checkpoint_path(&a, 4)]);
        let empty = folder.path().join("empty");
        fs::create_dir(&empty).unwrap();
        assert!(line(pool(&[empty])).ends_with("holds no run folder and no checkpoint"));
    }

    #[test]
    fn a_half_trained_policy_that_is_missing_is_never_replaced_by_the_full_one() {
        let folder = tempfile::tempdir().unwrap();
        let kept = run(&folder.path().join("kept"), &[2, 4]);
        let full = [checkpoint_path(&kept, 4)];
        assert_eq!(half_trained(&full, "--half").unwrap(), [checkpoint_path(&kept, 2)]);
        let lost = run(&folder.path().join("lost"), &[4]);
        let message = line(half_trained(&[checkpoint_path(&lost, 4)], "--half"));
        assert!(
            message.starts_with("crowd SO needs") && message.ends_with("name another with --half"),
            "{message}"
        );
        // Neither does a file outside a run stand for itself, nor one that is not called by its
        // updates.
        for file in ["000004.safetensors", "kept/checkpoints/best.safetensors"] {
            let file = folder.path().join(file);
            fs::write(&file, "").unwrap();
            let message = line(half_trained(&[file], "--half"));
            assert!(message.ends_with("is no run's checkpoint; name them with --half"), "{message}");
        }
    }

    #[test]
    fn a_path_that_leads_nowhere_is_answered_with_the_nearest_names() {
        let folder = tempfile::tempdir().unwrap();
        run(&folder.path().join("ours"), &[1]);
        fs::write(folder.path().join("m1-seed1.safetensors"), "").unwrap();
        fs::write(folder.path().join("ours.txt"), "").unwrap();
        let at = |name: &str| folder.path().join(name);
        let message = |name: &str| line(checkpoint_or(&at(name), "a robot", &["orca", "dwa"]));
        let missing = |name: &str, hint: &str| {
            format!("{}: found no such file or folder, expected a robot{hint}", at(name).display())
        };
        let offer = |name: &str| format!("; did you mean {}?", at(name).display());
        assert_eq!(message("our"), missing("our", &offer("ours")));
        assert_eq!(
            message("m1-sed1.safetensors"),
            missing("m1-sed1.safetensors", &offer("m1-seed1.safetensors"))
        );
        assert_eq!(message("orka"), missing("orka", "; did you mean orca?"));
        assert_eq!(message("nothing.safetensors"), missing("nothing.safetensors", ""));
        let bare = line(checkpoint_or(Path::new("dwaa"), "a robot", &["orca", "dwa"]));
        assert_eq!(bare, "dwaa: found no such file or folder, expected a robot; did you mean dwa?");
    }

    #[test]
    fn a_planner_is_named_by_its_name_alone() {
        let named = |name: &str| driver(Path::new(name));
        for planner in Planner::ALL {
            assert!(matches!(named(planner.name()).unwrap(), Driver::Planner(found) if found == planner));
        }
        let expected = "dwx: found no such file or folder, expected a checkpoint file, a run folder or a planner's name; \
                        did you mean dwa?";
        assert_eq!(line(named("dwx")), expected);
        assert!(line(named("./dwa")).starts_with("./dwa: found no such file or folder"));
    }
}
