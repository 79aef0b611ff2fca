//! The lines of a recording: who was where in which frame.

use serde::Deserialize;

/// A file's form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// `frame id x y`, separated by blanks, tabs or commas.
    Plain,
    /// ETH's `obsmat.txt`: `frame id x z y vx vz vy`, z being up.
    Obsmat,
    /// trajnet++: a JSON object a line, `track` or `scene`.
    Trajnet,
}

/// One annotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// Line in the file, from 1.
    pub(super) line: usize,
    pub(super) frame: i64,
    pub(super) id: i64,
    /// m.
    pub(super) place: [f64; 2],
}

/// A file's annotations, and the time between two of its frames (s) with the line that says it,
/// where one does.
#[derive(Debug, PartialEq)]
pub(super) struct File {
    pub(super) rows: Vec<Row>,
    pub(super) interval: Option<(usize, f64)>,
}

/// A line, from 1 (0 for the whole file), and what is wrong with it.
type Problem = (usize, String);

/// Reads all lines; empty ones are skipped.
pub(super) fn read(text: &str, format: Option<Format>) -> Result<File, Problem> {
    let mut file = File { rows: Vec::new(), interval: None };
    let mut format = format;
    for (index, line) in text.lines().enumerate() {
        let number = index + 1;
        if line.trim().is_empty() {
            continue;
        }
        let form = match format {
            Some(form) => form,
            None => *format.insert(form_of(line).map_err(|problem| (number, problem))?),
        };
        let row = match form {
            Format::Trajnet => trajnet(line, number, &mut file.interval),
            Format::Plain | Format::Obsmat => columns(line, number, form).map(Some),
        };
        file.rows.extend(row.map_err(|problem| (number, problem))?);
    }
    if file.rows.is_empty() {
        return Err((0, "found no line of a pedestrian, expected at least two".to_owned()));
    }
    Ok(file)
}

fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c.is_whitespace() || c == ',').filter(|field| !field.is_empty())
}

/// The form of a first line.
fn form_of(line: &str) -> Result<Format, String> {
    if line.trim_start().starts_with('{') {
        return Ok(Format::Trajnet);
    }
    match fields(line).count() {
        4 => Ok(Format::Plain),
        8 => Ok(Format::Obsmat),
        found => Err(format!("found {found} columns, expected 4 (frame id x y) or 8 (obsmat.txt)")),
    }
}

fn columns(line: &str, number: usize, form: Format) -> Result<Row, String> {
    let values = fields(line).map(parse).collect::<Result<Vec<f64>, _>>()?;
    let (expected, y) = if form == Format::Obsmat { (8, 4) } else { (4, 3) };
    if values.len() != expected {
        return Err(format!("found {} columns, expected {expected} as in the first line", values.len()));
    }
    let (frame, id) = (whole("frame", values[0])?, whole("pedestrian", values[1])?);
    Ok(Row { line: number, frame, id, place: [values[2], values[y]] })
}

fn parse(field: &str) -> Result<f64, String> {
    let value = field.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| format!("found {:?}, expected a number", field.chars().take(40).collect::<String>()))
}

fn whole(what: &str, value: f64) -> Result<i64, String> {
    if value.fract() == 0.0 && value.abs() <= 1e12 {
        Ok(value as i64)
    } else {
        Err(format!("{what}: found {value}, expected a whole number"))
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Line {
    Track {
        f: f64,
        p: f64,
        x: f64,
        y: f64,
        /// Of predictions, which are no annotations.
        #[serde(default)]
        prediction_number: Option<i64>,
    },
    Scene {
        #[serde(default)]
        fps: Option<f64>,
    },
}

/// The start of a text, for a message: a damaged line may be of any length.
fn start(text: &str) -> String {
    const MOST: usize = 120;
    if text.chars().count() <= MOST {
        return text.to_owned();
    }
    text.chars().take(MOST).chain(['…']).collect()
}

/// A row, or nothing for a scene, whose frame rate is noted and must be the same in all scenes.
fn trajnet(line: &str, number: usize, interval: &mut Option<(usize, f64)>) -> Result<Option<Row>, String> {
    let line: Line = serde_json::from_str(line).map_err(|error| {
        format!("expected a track or a scene of trajnet++: {}", start(&error.to_string()))
    })?;
    match line {
        Line::Track { prediction_number: Some(_), .. } | Line::Scene { fps: None } => Ok(None),
        Line::Track { f, p, x, y, prediction_number: None } => {
            let (frame, id) = (whole("f", f)?, whole("p", p)?);
            Ok(Some(Row { line: number, frame, id, place: [x, y] }))
        }
        Line::Scene { fps: Some(fps) } => {
            if !(0.01..=1000.0).contains(&fps) {
                return Err(format!("fps: found {fps}, expected 0.01 to 1000 frames a second"));
            }
            let (first, said) = *interval.get_or_insert((number, 1.0 / fps));
            if (said - 1.0 / fps).abs() > 1e-6 {
                let before = 1.0 / said;
                return Err(format!("fps: found {fps}, expected {before} as in line {first}"));
            }
            Ok(None)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_trajnet_are_tracks_scenes_and_nothing_else() {
        let read = |text: &str| read(text, Some(Format::Trajnet));
        let track = r#"{"track": {"f": 10, "p": 3, "x": 1.5, "y": -2.0}}"#;
        let scene = r#"{"scene": {"id": 1, "p": 3, "s": 10, "e": 20, "fps": 2.5, "tag": 2}}"#;
        let predicted =
            r#"{"track": {"f": 20, "p": 3, "x": 1, "y": 1, "prediction_number": 0, "scene_id": 1}}"#;
        let file = read(&format!("{scene}\n\n{track}\n{predicted}\n")).unwrap();
        assert_eq!(file.rows, [Row { line: 3, frame: 10, id: 3, place: [1.5, -2.0] }]);
        assert_eq!(file.interval, Some((1, 0.4)));
        let check = |text: &str, line: usize, part: &str| {
            let (found, problem) = read(text).unwrap_err();
            assert!(found == line && problem.contains(part), "line {found}: {problem}");
        };
        check(&format!("{track}\n{{}}\n"), 2, "expected a track or a scene");
        let (_, problem) = read(&format!("{{\"{}\": 1}}", "t".repeat(2000))).unwrap_err();
        assert!(problem.chars().count() < 200 && problem.ends_with('…'), "{problem}");
        check(&track.replace("\"x\"", "\"z\""), 1, "missing field `x`");
        check(&track.replace("\"f\": 10", "\"f\": 10.5"), 1, "f: found 10.5");
        check(&scene.replace("2.5", "0"), 1, "fps: found 0");
        let other = scene.replace("2.5", "5");
        check(&format!("{scene}\n{other}\n"), 2, "fps: found 5, expected 2.5 as in line 1");
        check(scene, 0, "found no line of a pedestrian");
    }

    #[test]
    fn the_first_line_says_the_form() {
        assert_eq!(form_of("{\"track\"").unwrap(), Format::Trajnet);
        assert_eq!(form_of("1,2,3.0,4.0").unwrap(), Format::Plain);
        assert_eq!(form_of(" 1 2 3 4 5 6 7 8").unwrap(), Format::Obsmat);
        let row = columns("780 1 8.4568 0 3.5880 1.7 0 0.2", 1, Format::Obsmat).unwrap();
        assert_eq!((row.frame, row.id, row.place), (780, 1, [8.4568, 3.588]));
    }
}
