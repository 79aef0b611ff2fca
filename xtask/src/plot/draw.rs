//! The pictures. SVG as text, so that nothing but a browser is needed to look at them, and no font to make them.

use anyhow::{Context as _, Result};
use jostle_eval::report::SuccessTable;
use jostle_peds::CrowdKind;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::curves::{Panel, Panels};

/// Okabe and Ito's colours, which the colour-blind can tell apart, without black and yellow.
const INKS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];
const GREY: RGBColor = RGBColor(110, 118, 129);
const PALE: RGBColor = RGBColor(228, 231, 235);
const DARK: RGBColor = RGBColor(36, 41, 47);
const FONT: &str = "sans-serif";
/// Width of every picture.
const WIDTH: u32 = 1260;
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

/// Learning curves: two rows of three panels under one legend.
pub(crate) fn curves(panels: &Panels) -> Result<String> {
    let entries: Vec<(String, RGBColor)> =
        panels.labels.iter().enumerate().map(|(k, label)| (label.clone(), ink(k))).collect();
    sheet((WIDTH, 724 + legend_height(&entries)), |area| {
        let (head, body) = area.split_vertically(legend_height(&entries));
        legend(&head, &entries)?;
        for (panel, cell) in panels.panels.iter().zip(body.split_evenly((2, 3))) {
            draw_panel(&cell, panel, panels.updates)?;
        }
        Ok(())
    })
}

/// Names beside squares of their colours, in as many lines as they need.
fn legend(head: &Area<'_>, entries: &[(String, RGBColor)]) -> Result<()> {
    for ((label, color), (x, y)) in entries.iter().zip(places(entries)) {
        head.draw(&Rectangle::new([(x, y + 2), (x + 14, y + 12)], color.filled()))?;
        head.draw(&Text::new(label.clone(), (x + 20, y), (FONT, 14).into_font().color(&DARK)))?;
    }
    Ok(())
}

/// Where the names of a legend stand.
fn places(entries: &[(String, RGBColor)]) -> Vec<(i32, i32)> {
    let (mut x, mut y) = (LEGEND_LEFT, 10);
    let mut places = Vec::new();
    for (label, _) in entries {
        let width = 44 + 7 * label.chars().count() as i32;
        if x > LEGEND_LEFT && x + width > WIDTH as i32 {
            (x, y) = (LEGEND_LEFT, y + LEGEND_LINE);
        }
        places.push((x, y));
        x += width;
    }
    places
}

/// Height of a legend.
fn legend_height(entries: &[(String, RGBColor)]) -> u32 {
    (places(entries).last().map_or(10, |(_, y)| *y) + LEGEND_LINE + 4) as u32
}

fn draw_panel(cell: &Area<'_>, panel: &Panel, updates: usize) -> Result<()> {
    let (low, high) = panel.range.unwrap_or_else(|| range(panel));
    let mut chart = ChartBuilder::on(cell)
        .margin(8)
        .margin_right(18)
        .caption(panel.title, (FONT, 15).into_font().color(&DARK))
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d(0.0..(updates as f64).max(1.0), low..high)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .axis_style(GREY)
        .x_labels(5)
        .y_labels(6)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| short(*y, high - low))
        .x_desc("updates")
        .label_style((FONT, 12).into_font().color(&GREY))
        .draw()?;
    for level in &panel.levels {
        let ends = [(0.0, *level), (updates as f64, *level)];
        chart.draw_series(DashedLineSeries::new(ends, 2, 4, GREY.stroke_width(1)))?;
    }
    for curve in &panel.curves {
        let color = ink(curve.group);
        let up = curve.points.iter().map(|p| (p[0], p[3]));
        let down = curve.points.iter().rev().map(|p| (p[0], p[2]));
        if curve.points.iter().any(|p| p[3] > p[2]) {
            chart
                .draw_series([Polygon::new(up.chain(down).collect::<Vec<_>>(), color.mix(0.18).filled())])?;
        }
        let mean = curve.points.iter().map(|p| (p[0], p[1]));
        let style = color.stroke_width(2);
        if curve.dashed {
            chart.draw_series(DashedLineSeries::new(mean, 5, 3, style))?;
        } else {
            chart.draw_series(LineSeries::new(mean, style))?;
        }
    }
    if panel.curves.iter().all(|curve| curve.points.is_empty()) {
        let (width, height) = cell.dim_in_pixel();
        let style =
            TextStyle::from((FONT, 13).into_font()).color(&GREY).pos(Pos::new(HPos::Center, VPos::Center));
        cell.draw_text("nothing to show: one behaviour", &style, (width as i32 / 2 + 20, height as i32 / 2))?;
    }
    Ok(())
}

/// The range of a panel's curves and levels with a little room around; 0 to 1 where there is nothing.
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

/// A table's success rates: a group of bars for each crowd, intervals as whiskers, the paper's figure as a diamond.
pub(crate) fn bars(table: &SuccessTable) -> Result<String> {
    let rows: Vec<_> = table.rows.iter().filter(|row| !row.cells.is_empty() || row.paper.is_some()).collect();
    let label = |labels: &[String]| -> String {
        let parts = table.label_heads.iter().zip(labels);
        parts.map(|(head, label)| format!("{head} {label}")).collect::<Vec<_>>().join(", ")
    };
    let entries: Vec<_> = rows.iter().enumerate().map(|(k, row)| (label(&row.labels), ink(k))).collect();
    sheet((WIDTH, 490 + legend_height(&entries)), |area| {
        let (title, rest) = area.split_vertically(34);
        title.draw(&Text::new(
            table.title.clone(),
            (LEGEND_LEFT, 12),
            (FONT, 18).into_font().color(&DARK),
        ))?;
        let (head, body) = rest.split_vertically(legend_height(&entries));
        legend(&head, &entries)?;
        let n_crowds = CrowdKind::ALL.len();
        let mut chart = ChartBuilder::on(&body)
            .margin(8)
            .margin_right(18)
            .x_label_area_size(54)
            .y_label_area_size(52)
            .build_cartesian_2d(0.0..n_crowds as f64, 0.0..1.0)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .axis_style(GREY)
            .x_labels(0)
            .y_labels(6)
            .y_label_formatter(&|y| format!("{y:.1}"))
            .y_desc("success rate")
            .label_style((FONT, 13).into_font().color(&GREY))
            .draw()?;
        let slot = 0.86 / rows.len().max(1) as f64;
        for (crowd_idx, crowd) in CrowdKind::ALL.into_iter().enumerate() {
            for (k, row) in rows.iter().enumerate() {
                let left = crowd_idx as f64 + 0.07 + slot * k as f64;
                let middle = left + 0.45 * slot;
                if let Some(cell) = row.cell(crowd) {
                    let rate = cell.summary.success_rate.unwrap_or(0.0);
                    let bar = [(left, 0.0), (left + 0.9 * slot, rate)];
                    chart.draw_series([Rectangle::new(bar, ink(k).mix(0.75).filled())])?;
                    if let Some(interval) = cell.summary.wilson_95 {
                        let whisker = [(middle, interval.low), (middle, interval.high)];
                        chart.draw_series([PathElement::new(whisker.to_vec(), DARK.stroke_width(2))])?;
                    }
                }
                if let Some((paper, _)) = row.paper {
                    let diamond = |(x, y)| {
                        EmptyElement::at((x, y))
                            + Polygon::new(vec![(0, -6), (6, 0), (0, 6), (-6, 0)], WHITE.filled())
                            + PathElement::new(
                                vec![(0, -6), (6, 0), (0, 6), (-6, 0), (0, -6)],
                                ink(k).stroke_width(2),
                            )
                    };
                    chart.draw_series([diamond((middle, paper[crowd_idx]))])?;
                }
            }
        }
        let (left, foot) = chart.backend_coord(&(0.0, 0.0));
        let (right, _) = chart.backend_coord(&(n_crowds as f64, 0.0));
        let centred = |size: i32, color: &'static RGBColor| {
            TextStyle::from((FONT, size).into_font()).color(color).pos(Pos::new(HPos::Center, VPos::Top))
        };
        for (index, crowd) in CrowdKind::ALL.into_iter().enumerate() {
            let x = left + (f64::from(right - left) * (index as f64 + 0.5) / n_crowds as f64) as i32;
            area.draw_text(crowd.name(), &centred(15, &DARK), (x, foot + 6))?;
        }
        let note = "bars: ours, with 95 % Wilson intervals; diamonds: the paper's figures";
        area.draw_text(note, &centred(12, &GREY), (i32::midpoint(left, right), foot + 30))?;
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn ticks_have_the_digits_that_they_need() {
        assert_eq!((short(0.2, 1.0).as_str(), short(-30.0, 40.0).as_str()), ("0.2", "-30"));
        assert_eq!((short(-0.000_1, 1.0).as_str(), short(0.001, 0.01).as_str()), ("0", "0.001"));
    }
}
