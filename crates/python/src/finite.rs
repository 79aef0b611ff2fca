//! The gate before a policy: no number that is none reaches it, as its answer would look like any
//! other.

use jostle_sim::EXTRAS;

/// The last numbers of a row.
const NAMES: [&str; EXTRAS] = ["goal x", "goal y", "v", "ω"];

/// Refuses rows `[B, width]` with a number that is NaN or infinite.
///
/// # Errors
///
/// One line that names the row and the entry.
pub fn check_rows(rows: &[f32], width: usize) -> Result<(), String> {
    let Some(at) = rows.iter().position(|value| !value.is_finite()) else { return Ok(()) };
    let (row, entry, found) = (at / width, at % width, rows[at]);
    let name = entry.checked_sub(width - EXTRAS).map_or("a range", |extra| NAMES[extra]);
    let hint = if name == "a range" { "; jostle.scan_to_row takes a scanner's own numbers" } else { "" };
    Err(format!(
        "observations: found {found} in row {row}, entry {entry} ({name}), expected finite numbers{hint}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_and_entry_are_named() {
        let mut rows = vec![0.5; 2 * 10];
        assert_eq!(check_rows(&rows, 10), Ok(()));
        rows[17] = f32::INFINITY;
        let message = "observations: found inf in row 1, entry 7 (goal y), expected finite numbers";
        assert_eq!(check_rows(&rows, 10).unwrap_err(), message);
        rows[2] = f32::NAN;
        let message = "observations: found NaN in row 0, entry 2 (a range), expected finite numbers; ";
        assert!(check_rows(&rows, 10).unwrap_err().starts_with(message));
        for (entry, name) in [(6, "goal x"), (8, "v"), (9, "ω")] {
            let mut row = vec![0.0; 10];
            row[entry] = f32::NEG_INFINITY;
            let message = check_rows(&row, 10).unwrap_err();
            assert!(message.contains(&format!("found -inf in row 0, entry {entry} ({name})")), "{message}");
        }
    }
}
