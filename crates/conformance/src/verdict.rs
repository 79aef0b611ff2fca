//! Collects the comparisons made on one file and remembers the worst.

use std::fmt::Write as _;

/// The comparisons made on one file.
#[derive(Default)]
pub(crate) struct Verdict {
    comparisons: u64,
    failures: u64,
    worst: Option<Worst>,
    problem: Option<String>,
}

struct Worst {
    error: f64,
    tolerance: f64,
    what: String,
}

impl Verdict {
    /// Compares one number: it passes when |actual − expected| ≤ atol + rtol·|expected|.
    ///
    /// `what` names the number; it is called only for the worst one so far.
    pub(crate) fn close(
        &mut self,
        actual: f64,
        expected: f64,
        atol: f64,
        rtol: f64,
        what: impl FnOnce() -> String,
    ) {
        let error = if actual == expected { 0.0 } else { (actual - expected).abs() };
        self.error(error, atol + rtol * expected.abs(), what);
    }

    /// Judges an error that the caller computed; NaN fails.
    pub(crate) fn error(&mut self, error: f64, tolerance: f64, what: impl FnOnce() -> String) {
        self.comparisons += 1;
        let error = if error.is_nan() { f64::INFINITY } else { error };
        // A NaN tolerance comes from a damaged file and passes nothing.
        let passes = error <= tolerance;
        self.failures += u64::from(!passes);
        let share = |error: f64, tolerance: f64| if error == 0.0 { 0.0 } else { error / tolerance };
        let worse = self.worst.as_ref().is_none_or(|w| {
            let (new, old) = (share(error, tolerance), share(w.error, w.tolerance));
            new.is_nan() || new > old
        });
        if worse {
            self.worst = Some(Worst { error, tolerance, what: what() });
        }
    }

    /// Compares slices entry by entry; different lengths are a problem of their own.
    pub(crate) fn all_close(
        &mut self,
        actual: impl ExactSizeIterator<Item = f64>,
        expected: impl ExactSizeIterator<Item = f64>,
        (atol, rtol): (f64, f64),
        what: &str,
    ) {
        if actual.len() != expected.len() {
            self.problem(format!("{what}: {} values where {} are expected", actual.len(), expected.len()));
            return;
        }
        for (index, (a, e)) in actual.zip(expected).enumerate() {
            self.close(a, e, atol, rtol, || format!("{what}[{index}]"));
        }
    }

    /// Compares an optional number with one that may be undefined (`null`).
    pub(crate) fn close_or_none(
        &mut self,
        actual: Option<f64>,
        expected: Option<f64>,
        tolerance: f64,
        what: &str,
    ) {
        match (actual, expected) {
            (Some(a), Some(e)) => self.close(a, e, tolerance, 0.0, || what.to_owned()),
            (None, None) => self.comparisons += 1,
            _ => self.problem(format!("{what}: {actual:?} where {expected:?} is expected")),
        }
    }

    /// Compares something that is right or wrong.
    pub(crate) fn same<T: PartialEq + std::fmt::Debug>(
        &mut self,
        actual: &T,
        expected: &T,
        what: impl FnOnce() -> String,
    ) {
        self.comparisons += 1;
        if actual != expected {
            self.problem(format!("{}: {actual:?} where {expected:?} is expected", what()));
        }
    }

    /// A fault that is no number. The first one is shown.
    pub(crate) fn problem(&mut self, text: String) {
        self.failures += 1;
        self.problem.get_or_insert(text);
    }

    /// True when something was compared and nothing failed.
    pub(crate) fn passed(&self) -> bool {
        self.failures == 0 && self.comparisons > 0
    }

    /// The finding, without the word PASS or FAIL.
    pub(crate) fn summary(&self) -> String {
        let mut text = match &self.worst {
            Some(Worst { error, tolerance, what }) => {
                format!(
                    "worst {error:.1e}, tolerance {tolerance:.1e} ({what}); {} comparisons",
                    self.comparisons
                )
            }
            None => format!("{} comparisons", self.comparisons),
        };
        if self.failures > 0 {
            let _ = write!(text, ", {} failed", self.failures);
        } else if self.comparisons == 0 {
            text.push_str(": nothing to compare");
        }
        if let Some(problem) = &self.problem {
            let _ = write!(text, "; {problem}");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::Verdict;

    #[test]
    fn the_worst_is_the_one_nearest_to_its_tolerance() {
        let mut verdict = Verdict::default();
        verdict.close(1.0, 1.5, 10.0, 0.0, || "large but loose".to_owned());
        verdict.close(1.0, 1.000_9, 1e-3, 0.0, || "small but tight".to_owned());
        assert!(verdict.passed());
        assert!(verdict.summary().contains("small but tight"), "{}", verdict.summary());
    }

    #[test]
    fn nothing_compared_nan_and_a_problem_fail() {
        assert!(!Verdict::default().passed());
        let mut verdict = Verdict::default();
        verdict.close(f64::NAN, 0.0, 1.0, 0.0, || "x".to_owned());
        assert!(!verdict.passed());
        let mut verdict = Verdict::default();
        verdict.close(0.0, 0.0, 0.0, 0.0, || "x".to_owned());
        assert!(verdict.passed());
        verdict.all_close([1.0].into_iter(), [1.0, 2.0].into_iter(), (1.0, 0.0), "y");
        assert!(!verdict.passed());
    }
}
