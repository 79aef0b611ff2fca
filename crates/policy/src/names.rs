//! Names that were probably meant: what a message offers for one that nobody knows.

/// Most names that a message offers.
const MOST: usize = 3;

/// The candidates that resemble `name`, the most similar first, at most three; those that are
/// equally similar keep their order.
///
/// A candidate resembles the name if it contains it, or if at most a third of the letters of the
/// longer one would have to be changed, added, left out or swapped with the next (optimal string
/// alignment). Case does not matter.
///
/// # Examples
///
/// ```
/// assert_eq!(jostle_policy::nearest("noise", ["sim.laser.noise_std", "seed"]), ["sim.laser.noise_std"]);
/// assert_eq!(jostle_policy::nearest("DAW", ["orca", "dwa"]), ["dwa"]);
/// assert!(jostle_policy::nearest("warehouse", ["orca", "dwa"]).is_empty());
/// ```
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let name = name.to_lowercase();
    let mut similar: Vec<(usize, &str)> = candidates
        .into_iter()
        .filter_map(|candidate| Some((distance(&name, &candidate.to_lowercase())?, candidate)))
        .collect();
    // Stable, so that the order of equals is the caller's.
    similar.sort_by_key(|(distance, _)| *distance);
    similar.into_iter().take(MOST).map(|(_, candidate)| candidate).collect()
}

/// [`nearest`] as the end of a message, by [`offer`].
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    offer(&nearest(name, candidates))
}

/// Names as the end of a message: `; did you mean dwa or orca?`, or nothing where there are none.
pub fn offer(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [only] => format!("; did you mean {only}?"),
        [first @ .., last] => format!("; did you mean {} or {last}?", first.join(", ")),
    }
}

/// Edits from one name to the other, if they resemble each other.
fn distance(name: &str, candidate: &str) -> Option<usize> {
    let longer = name.chars().count().max(candidate.chars().count());
    let edits = strsim::osa_distance(name, candidate);
    let contained = !name.is_empty() && candidate.contains(name);
    (contained || edits <= longer / 3).then_some(edits)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROBOTS: [&str; 6] = ["straight", "brake", "goal-seeker", "dwa", "orca", "social-force"];

    #[test]
    fn a_slip_finds_the_name_that_was_meant() {
        for (slip, meant) in [
            ("straigth", "straight"),
            ("brkae", "brake"),
            ("goalseeker", "goal-seeker"),
            ("DWA", "dwa"),
            ("orka", "orca"),
            ("social_force", "social-force"),
            ("seeker", "goal-seeker"),
        ] {
            assert_eq!(nearest(slip, ROBOTS), [meant], "{slip}");
        }
    }

    #[test]
    fn what_resembles_nothing_finds_nothing() {
        for name in ["", "x", "zz", "nothing.safetensors", "runs/ours"] {
            assert!(nearest(name, ROBOTS).is_empty(), "{name}: {:?}", nearest(name, ROBOTS));
        }
    }

    #[test]
    fn the_nearest_comes_first_and_equals_keep_their_order() {
        let names = ["m5-seed1", "m1-seed3", "m1-seed1", "m1-seed2", "m1"];
        assert_eq!(nearest("m1", names), ["m1", "m1-seed3", "m1-seed1"]);
        assert_eq!(did_you_mean("m1-seed4", names), "; did you mean m1-seed3, m1-seed1 or m1-seed2?");
        assert_eq!(did_you_mean("m5-sed1", ["m5-seed1"]), "; did you mean m5-seed1?");
        assert_eq!(did_you_mean("z", names), "");
    }
}
