//! Curves with bands: learning curves, losses.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;

use super::{Area, DARK, Entry, FONT, GREY, PALE, WIDTH, centred, ink, legend, legend_height, sheet};
use crate::curves::{Axis, Panel, Panels};

/// Size of a panel.
const CELL: (u32, u32) = (WIDTH / COLUMNS, 362);
/// Panels side by side.
const COLUMNS: u32 = 3;
/// Size of the panels of a picture that has fewer than fill a line.
const LARGE: (u32, u32) = (620, 440);

/// The panels under one legend, three in a line.
pub fn curves(panels: &Panels) -> Result<String> {
    let entries: Vec<Entry> =
        panels.labels.iter().enumerate().map(|(k, label)| (label.clone(), ink(k))).collect();
    let n_panels = panels.panels.len().max(1) as u32;
    let n_columns = n_panels.min(COLUMNS);
    let cell = if n_panels < COLUMNS { LARGE } else { CELL };
    let (width, n_lines) = (cell.0 * n_columns, n_panels.div_ceil(n_columns));
    let head = legend_height(&entries, width);
    sheet((width, cell.1 * n_lines + head), |area| {
        let (strip, body) = area.split_vertically(head);
        legend(&strip, &entries)?;
        let cells = body.split_evenly((n_lines as usize, n_columns as usize));
        for (panel, cell) in panels.panels.iter().zip(cells) {
            draw_panel(&cell, panel, panels.axis)?;
        }
        Ok(())
    })
}

impl Axis {
    /// Its ends, in the coordinate that is drawn.
    fn ends(self) -> (f64, f64) {
        match self {
            Self::Updates(n) => (0.0, (n as f64).max(1.0)),
            Self::Transitions(from, to) => (from.log10(), to.log10()),
            Self::Ranks(from, to) => (from.log2(), to.log2()),
        }
    }

    fn place(self, x: f64) -> f64 {
        match self {
            Self::Updates(_) => x,
            Self::Transitions(..) => x.log10(),
            Self::Ranks(..) => x.log2(),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Updates(_) => "updates",
            Self::Transitions(..) => "transitions (millions, logarithmic)",
            Self::Ranks(..) => "ranks (logarithmic)",
        }
    }

    /// A tick's number.
    fn label(self, drawn: f64) -> String {
        match self {
            Self::Updates(_) => format!("{drawn:.0}"),
            Self::Transitions(..) => {
                let millions = 10_f64.powf(drawn - 6.0);
                if millions < 9.95 { format!("{millions:.1}") } else { format!("{millions:.0}") }
            }
            Self::Ranks(..) => format!("{:.0}", drawn.exp2()),
        }
    }
}

fn draw_panel(cell: &Area<'_>, panel: &Panel, axis: Axis) -> Result<()> {
    let (low, high) = panel.range.unwrap_or_else(|| range(panel));
    let (left, right) = axis.ends();
    let mut chart = ChartBuilder::on(cell)
        .margin(8)
        .margin_right(18)
        .caption(&panel.title, (FONT, 15).into_font().color(&DARK))
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(left..right, low..high)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .axis_style(GREY)
        .x_labels(5)
        .y_labels(6)
        .x_label_formatter(&|x| axis.label(*x))
        .y_label_formatter(&|y| short(*y, high - low))
        .x_desc(axis.name())
        .label_style((FONT, 12).into_font().color(&GREY))
        .draw()?;
    for level in &panel.levels {
        let ends = [(left, *level), (right, *level)];
        chart.draw_series(DashedLineSeries::new(ends, 2, 4, GREY.stroke_width(1)))?;
    }
    for curve in &panel.curves {
        let color = ink(curve.group);
        let up = curve.points.iter().map(|p| (axis.place(p[0]), p[3]));
        let down = curve.points.iter().rev().map(|p| (axis.place(p[0]), p[2]));
        if curve.points.iter().any(|p| p[3] > p[2]) {
            chart
                .draw_series([Polygon::new(up.chain(down).collect::<Vec<_>>(), color.mix(0.18).filled())])?;
        }
        let mean = curve.points.iter().map(|p| (axis.place(p[0]), p[1]));
        let style = color.stroke_width(2);
        if curve.dashed {
            chart.draw_series(DashedLineSeries::new(mean, 5, 3, style))?;
        } else {
            chart.draw_series(LineSeries::new(mean, style))?;
        }
    }
    if panel.curves.iter().all(|curve| curve.points.is_empty()) {
        let (width, height) = cell.dim_in_pixel();
        let middle = (width as i32 / 2 + 20, height as i32 / 2);
        cell.draw_text(panel.empty, &centred(13, &GREY, VPos::Center), middle)?;
    }
    Ok(())
}

/// The range of a panel's curves and levels with a little room around; 0 to 1 where there is
/// nothing.
fn range(panel: &Panel) -> (f64, f64) {
    let values = panel.curves.iter().flat_map(|curve| &curve.points).flat_map(|p| [p[2], p[3]]);
    let (low, high) = values
        .chain(panel.levels.iter().copied())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    match high - low {
        width if width > 0.0 && width.is_finite() => (low - 0.06 * width, high + 0.06 * width),
        _ if low.is_finite() => (low - 0.5, low + 0.5),
        _ => (0.0, 1.0),
    }
}

/// A tick's number with as many digits as the axis' width asks for.
fn short(value: f64, width: f64) -> String {
    let digits = (0.9 - width.log10()).ceil().clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { "0".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::{Axis, short};

    #[test]
    fn decades_of_transitions_are_equally_wide() {
        let axis = Axis::Transitions(1e6, 1e8);
        assert_eq!(axis.ends(), (6.0, 8.0));
        assert_eq!((axis.place(1e7), axis.label(7.0).as_str(), axis.label(6.5).as_str()), (7.0, "10", "3.2"));
    }

    #[test]
    fn ticks_have_the_digits_that_they_need() {
        assert_eq!((short(0.2, 1.0).as_str(), short(-30.0, 40.0).as_str()), ("0.2", "-30"));
        assert_eq!((short(-0.000_1, 1.0).as_str(), short(0.001, 0.01).as_str()), ("0", "0.001"));
    }
}
