//! Results on standard output, messages on standard error, an error as one line.

use std::io::Write as _;
use std::sync::OnceLock;

use anyhow::{Context as _, Result};

/// The name of the commands in a checkout.
pub const PROGRAM_OF_CHECKOUT: &str = "cargo xtask";

static PROGRAM: OnceLock<&str> = OnceLock::new();

/// Sets what [`program`] answers; the first call counts.
pub fn set_program(name: &'static str) {
    PROGRAM.get_or_init(|| name);
}

/// The user's name for this program, for advice: `cargo xtask`, or `jostle` where it is installed.
pub fn program() -> &'static str {
    PROGRAM.get().copied().unwrap_or(PROGRAM_OF_CHECKOUT)
}

/// Writes text, which should end with a newline, to standard output.
///
/// # Errors
/// When standard output is closed, which `print!` would answer with a panic.
pub fn result(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).context("cannot write to standard output")
}

/// Writes one message line to standard error; a closed standard error is no reason to stop working.
pub fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// The chain of an error, outermost first, as one line. A cause that the message before it tells
/// already, as the errors of some libraries do, is not told again.
pub fn one_line(error: &anyhow::Error) -> String {
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

/// Joins the lines of a message; source excerpts of a TOML error (`3 | key = …`, `  | ^^^`) are
/// left out.
pub fn flatten(message: &str) -> String {
    let kept: Vec<&str> =
        message.lines().map(str::trim).filter(|line| !line.is_empty() && !is_excerpt(line)).collect();
    kept.join(" ")
}

fn is_excerpt(line: &str) -> bool {
    line.split_once('|').is_some_and(|(gutter, _)| gutter.trim().chars().all(|c| c.is_ascii_digit()))
}

/// Rows of cells as text in columns; a short row fills what it has.
pub fn columns(rows: &[Vec<String>]) -> String {
    let widest = rows.iter().map(Vec::len).max().unwrap_or(0);
    let complete = |row: &&Vec<String>| row.len() == widest;
    let width = |column: usize| {
        rows.iter().filter(complete).map(|row| row[column].chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..widest).map(width).collect();
    rows.iter()
        .map(|row| {
            let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}"));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    use super::{columns, flatten, one_line};

    #[test]
    fn a_cause_is_told_once() {
        #[derive(Debug)]
        struct Twice(std::io::Error);
        impl std::fmt::Display for Twice {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a.toml: cannot read: {}", self.0)
            }
        }
        impl std::error::Error for Twice {
            fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
                Some(&self.0)
            }
        }

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

    #[test]
    fn columns_stand_under_each_other() {
        let rows = [vec!["a".to_owned(), "bb".to_owned()], vec!["ccc".to_owned(), "d".to_owned()]];
        assert_eq!(columns(&rows), "a    bb\nccc  d\n");
    }
}
