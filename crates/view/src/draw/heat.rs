//! Rates in a grid, such as every token of a policy in every crowd.

use anyhow::{Result, ensure};
use jostle_eval::statistics::Interval;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Area, DARK, FONT, GREY, PALE, TITLE, centred, sheet, title};

const LEFT: i32 = 190;
const COLUMN: i32 = 118;
const ROW: i32 = 54;
const HEAD: i32 = 34;
/// Room for the note and the scale of colours.
const FOOT: i32 = 62;
/// Colours at 0, ½ and 1: lightness falls evenly, so that a grey print tells them apart, too.
const STOPS: [[f64; 3]; 3] = [[247.0, 247.0, 240.0], [103.0, 169.0, 189.0], [16.0, 62.0, 110.0]];

/// A rate with its interval.
#[derive(Clone, Copy, Debug)]
pub struct Rate {
    /// From 0 to 1.
    pub value: f64,
    /// Its 95 % interval.
    pub interval: Option<Interval>,
}

/// A grid of rates.
#[derive(Clone, Debug)]
pub struct HeatMap {
    /// The title.
    pub title: String,
    /// Names of the rows and of the columns.
    pub rows: Vec<String>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Row by row; `None` where nothing was measured.
    pub cells: Vec<Vec<Option<Rate>>>,
    /// A line below the grid: episodes, intervals.
    pub note: String,
}

/// Draws the grid; each cell says its rate and, below, its interval.
///
/// # Errors
/// A grid whose cells are not as many as its names.
pub fn heat_map(map: &HeatMap) -> Result<String> {
    let (n_rows, n_columns) = (map.rows.len(), map.columns.len());
    ensure!(
        map.cells.len() == n_rows && map.cells.iter().all(|row| row.len() == n_columns),
        "a heat map of {n_rows} rows and {n_columns} columns has other cells than these"
    );
    let grid = (COLUMN * n_columns as i32, ROW * n_rows as i32);
    let size = (LEFT + grid.0 + 30, TITLE as i32 + HEAD + grid.1 + FOOT);
    sheet((size.0.max(560) as u32, size.1 as u32), |area| {
        let (strip, body) = area.split_vertically(TITLE);
        title(&strip, &map.title)?;
        for (index, name) in map.columns.iter().enumerate() {
            let x = LEFT + COLUMN * index as i32 + COLUMN / 2;
            body.draw_text(name, &centred(15, &DARK, VPos::Center), (x, HEAD / 2))?;
        }
        for (index, (name, cells)) in map.rows.iter().zip(&map.cells).enumerate() {
            let top = HEAD + ROW * index as i32;
            let style = TextStyle::from((FONT, 15).into_font()).color(&DARK);
            let style = style.pos(Pos::new(HPos::Right, VPos::Center));
            body.draw_text(name, &style, (LEFT - 12, top + ROW / 2))?;
            for (column, cell) in cells.iter().enumerate() {
                draw_cell(&body, (LEFT + COLUMN * column as i32, top), *cell)?;
            }
        }
        foot(&body, HEAD + grid.1, &map.note)
    })
}

fn draw_cell(body: &Area<'_>, (left, top): (i32, i32), cell: Option<Rate>) -> Result<()> {
    let corners = [(left + 1, top + 1), (left + COLUMN - 1, top + ROW - 1)];
    let middle = left + COLUMN / 2;
    let Some(rate) = cell else {
        body.draw(&Rectangle::new(corners, PALE.filled()))?;
        body.draw_text("–", &centred(15, &GREY, VPos::Center), (middle, top + ROW / 2))?;
        return Ok(());
    };
    body.draw(&Rectangle::new(corners, colour(rate.value).filled()))?;
    let text = if rate.value > 0.62 { &WHITE } else { &DARK };
    let value = format!("{:.3}", rate.value);
    let Some(interval) = rate.interval else {
        body.draw_text(&value, &centred(17, text, VPos::Center), (middle, top + ROW / 2))?;
        return Ok(());
    };
    body.draw_text(&value, &centred(17, text, VPos::Center), (middle, top + ROW / 2 - 9))?;
    let ends = format!("{:.3} – {:.3}", interval.low, interval.high);
    body.draw_text(&ends, &centred(12, text, VPos::Center), (middle, top + ROW / 2 + 12))?;
    Ok(())
}

/// The note, and the colours from 0 to 1.
fn foot(body: &Area<'_>, top: i32, note: &str) -> Result<()> {
    let style = TextStyle::from((FONT, 12).into_font()).color(&GREY);
    body.draw_text(note, &style, (60, top + 40))?;
    for step in 0..100 {
        let left = LEFT + 2 * step;
        let strip = [(left, top + 14), (left + 2, top + 24)];
        body.draw(&Rectangle::new(strip, colour((f64::from(step) + 0.5) / 100.0).filled()))?;
    }
    body.draw_text("0", &centred(12, &GREY, VPos::Center), (LEFT - 10, top + 19))?;
    body.draw_text("1", &centred(12, &GREY, VPos::Center), (LEFT + 210, top + 19))?;
    Ok(())
}

/// A rate's colour: straight lines between the stops.
fn colour(rate: f64) -> RGBColor {
    let at = 2.0 * rate.clamp(0.0, 1.0);
    let (from, to) = if at < 1.0 { (STOPS[0], STOPS[1]) } else { (STOPS[1], STOPS[2]) };
    let share = if at < 1.0 { at } else { at - 1.0 };
    let [r, g, b] = [0, 1, 2].map(|k| (from[k] + share * (to[k] - from[k])).round() as u8);
    RGBColor(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::{HeatMap, Rate, colour, heat_map};

    #[test]
    fn colours_go_through_the_stops() {
        let rgb = |rate| {
            let color = colour(rate);
            [color.0, color.1, color.2]
        };
        assert_eq!([rgb(0.0), rgb(0.5), rgb(1.0)], [[247, 247, 240], [103, 169, 189], [16, 62, 110]]);
        assert_eq!(rgb(f64::from(7)), rgb(1.0));
    }

    #[test]
    fn a_cell_says_its_rate_and_a_hole_is_a_dash() {
        let map = HeatMap {
            title: "Tokens".to_owned(),
            rows: vec!["z = 0".to_owned()],
            columns: vec!["VO".to_owned(), "SF".to_owned()],
            cells: vec![vec![Some(Rate { value: 0.625, interval: None }), None]],
            note: String::new(),
        };
        let picture = heat_map(&map).unwrap();
        assert!(picture.contains("0.625") && picture.contains('–') && picture.contains("z = 0"));
        let torn = HeatMap { cells: vec![vec![None]], ..map };
        assert!(heat_map(&torn).is_err());
    }
}
