//! Results on standard output, messages on standard error, an error as one line.

use std::io::Write as _;

use anyhow::{Context as _, Result};

/// Writes text, which should end with a newline, to standard output.
///
/// # Errors
/// When standard output is closed, which `print!` would answer with a panic.
pub(crate) fn result(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).context("cannot write to standard output")
}

/// Writes one message line to standard error; a closed standard error is no reason to stop working.
pub(crate) fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// The chain of an error, outermost first, as one line. A cause that the message before it tells already, as the errors of some
/// libraries do, is not told again.
pub(crate) fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    flatten(&line)
}

/// Joins the lines of a message; source excerpts of a TOML error (`3 | key = …`, `  | ^^^`) are left out.
pub(crate) fn flatten(message: &str) -> String {
    let kept: Vec<&str> =
        message.lines().map(str::trim).filter(|line| !line.is_empty() && !is_excerpt(line)).collect();
    kept.join(" ")
}

fn is_excerpt(line: &str) -> bool {
    line.split_once('|').is_some_and(|(gutter, _)| gutter.trim().chars().all(|c| c.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::{flatten, one_line};

    #[test]
    fn a_cause_is_told_once() {
        #[derive(Debug, thiserror::Error)]
        #[error("a.toml: cannot read: {0}")]
        struct Twice(#[source] std::io::Error);

        let cause = || std::io::Error::other("no such file");
        assert_eq!(one_line(&anyhow::Error::from(Twice(cause()))), "a.toml: cannot read: no such file");
        let deeper = Err::<(), _>(cause()).context("cannot read").context("cannot start").unwrap_err();
        assert_eq!(one_line(&deeper), "cannot start: cannot read: no such file");
    }

    #[test]
    fn a_toml_error_becomes_one_line_without_its_excerpt() {
        let message = "bad config: TOML parse error at line 2, column 1\n  |\n2 | sede = 1\n  | ^^^^\nunknown field `sede`\n";
        assert_eq!(flatten(message), "bad config: TOML parse error at line 2, column 1 unknown field `sede`");
    }
}
