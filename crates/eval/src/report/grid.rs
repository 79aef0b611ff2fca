//! A table of strings, laid out for a terminal or as Markdown.

/// A table of strings with a header; `rule_before` marks rows that start a new group.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Grid {
    header: Vec<String>,
    rows: Vec<(bool, Vec<String>)>,
}

impl Grid {
    /// An empty grid with these column heads.
    pub fn new<S: Into<String>>(header: impl IntoIterator<Item = S>) -> Self {
        Self { header: header.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Appends a row.
    ///
    /// # Panics
    ///
    /// If it has not one entry per column.
    pub fn push(&mut self, starts_group: bool, row: Vec<String>) {
        assert_eq!(row.len(), self.header.len(), "one entry per column");
        self.rows.push((starts_group, row));
    }

    /// Columns padded by spaces, a rule under the header and an empty line between groups.
    pub fn text(&self) -> String {
        let widths: Vec<usize> = (0..self.header.len())
            .map(|col| {
                let cells = self.rows.iter().map(|(_, row)| &row[col]).chain([&self.header[col]]);
                cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
            })
            .collect();
        let line = |row: &[String]| {
            let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        };
        let mut text = line(&self.header);
        let total = widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1);
        text += &("─".repeat(total) + "\n");
        for (idx, (starts_group, row)) in self.rows.iter().enumerate() {
            if *starts_group && idx > 0 {
                text.push('\n');
            }
            text += &line(row);
        }
        text
    }

    /// A GitHub-flavoured Markdown table.
    pub fn markdown(&self) -> String {
        let line = |row: &[String]| {
            let cells: Vec<String> = row.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let mut text = line(&self.header);
        text = text + "|" + &"---|".repeat(self.header.len()) + "\n";
        for (_, row) in &self.rows {
            text += &line(row);
        }
        text
    }
}

/// One line of CSV: fields with a comma, a quote or a line break are quoted (RFC 4180).
pub fn csv_line<S: AsRef<str>>(fields: impl IntoIterator<Item = S>) -> String {
    let quote = |field: S| {
        let field = field.as_ref();
        if field.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", field.replace('"', "\"\""))
        } else {
            field.to_owned()
        }
    };
    fields.into_iter().map(quote).collect::<Vec<_>>().join(",") + "\n"
}

/// A number with fixed decimals, or a dash where there is none.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_markdown_and_csv() {
        let mut grid = Grid::new(["a", "bb"]);
        grid.push(true, vec!["±1".into(), "x|y".into()]);
        grid.push(true, vec!["long".into(), String::new()]);
        assert_eq!(grid.text(), "a     bb\n─────────\n±1    x|y\n\nlong\n");
        assert_eq!(grid.markdown(), "| a | bb |\n|---|---|\n| ±1 | x\\|y |\n| long |  |\n");
        assert_eq!(csv_line(["a", "b,c", "d\"e"]), "a,\"b,c\",\"d\"\"e\"\n");
        assert_eq!((number(None, 2), number(Some(0.125), 3)), ("–".into(), "0.125".into()));
    }
}
