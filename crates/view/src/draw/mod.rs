//! The pictures. SVG as text, so that nothing but a browser is needed to look at them, and no font
//! to make them.
//!
//! Reading order: this file (sheet, colours, legend); [`panels`] (curves with bands), [`bars`] (a
//! table beside the paper's), [`heat`] (rates in a grid), [`paths`] (ways through a room). Each
//! takes plain data and gives the text of an SVG.

pub mod bars;
pub mod heat;
pub mod panels;
pub mod paths;

use anyhow::{Context as _, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Okabe and Ito's colours, which the colour-blind can tell apart, with grey for their black and a
/// darker yellow; then brown.
const INKS: [RGBColor; 9] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(64, 64, 64),
    RGBColor(190, 174, 0),
    RGBColor(128, 64, 24),
];
const GREY: RGBColor = RGBColor(110, 118, 129);
const PALE: RGBColor = RGBColor(228, 231, 235);
const DARK: RGBColor = RGBColor(36, 41, 47);
const FONT: &str = "sans-serif";
/// Width of a picture of three panels.
const WIDTH: u32 = 1260;
/// Height of a title's strip.
const TITLE: u32 = 34;
const LEGEND_LEFT: i32 = 60;
const LEGEND_LINE: i32 = 20;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn ink(index: usize) -> RGBColor {
    INKS[index % INKS.len()]
}

/// Runs a drawing on a white sheet of the given size.
fn sheet(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present().context("cannot finish the picture")?;
    }
    Ok(text)
}

/// A picture's title, in a strip of height [`TITLE`].
fn title(strip: &Area<'_>, text: &str) -> Result<()> {
    let style = (FONT, 18).into_font().color(&DARK);
    strip.draw(&Text::new(text.to_owned(), (LEGEND_LEFT, 12), style))?;
    Ok(())
}

/// Text around a point.
fn centred(size: i32, color: &RGBColor, vertical: VPos) -> TextStyle<'_> {
    TextStyle::from((FONT, size).into_font()).color(color).pos(Pos::new(HPos::Center, vertical))
}

/// A name in a legend with its colour.
type Entry = (String, RGBColor);

/// Names beside squares of their colours, in as many lines as they need.
fn legend(head: &Area<'_>, entries: &[Entry]) -> Result<()> {
    for ((label, color), (x, y)) in entries.iter().zip(places(entries, head.dim_in_pixel().0)) {
        head.draw(&Rectangle::new([(x, y + 2), (x + 14, y + 12)], color.filled()))?;
        head.draw(&Text::new(label.clone(), (x + 20, y), (FONT, 14).into_font().color(&DARK)))?;
    }
    Ok(())
}

/// Places of the names of a legend.
fn places(entries: &[Entry], sheet_width: u32) -> Vec<(i32, i32)> {
    let (mut x, mut y) = (LEGEND_LEFT, 10);
    let mut places = Vec::new();
    for (label, _) in entries {
        let width = 44 + 7 * label.chars().count() as i32;
        if x > LEGEND_LEFT && x + width > sheet_width as i32 {
            (x, y) = (LEGEND_LEFT, y + LEGEND_LINE);
        }
        places.push((x, y));
        x += width;
    }
    places
}

/// Height of a legend.
fn legend_height(entries: &[Entry], sheet_width: u32) -> u32 {
    (places(entries, sheet_width).last().map_or(10, |(_, y)| *y) + LEGEND_LINE + 4) as u32
}
