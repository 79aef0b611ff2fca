//! A table of success rates as bars, beside the paper's figures.

use anyhow::Result;
use jostle_eval::report::SuccessTable;
use jostle_peds::CrowdKind;
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;

use super::{DARK, Entry, FONT, GREY, PALE, TITLE, WIDTH, centred, ink, legend, legend_height, sheet, title};

/// A table's success rates: a group of bars for each crowd, intervals as whiskers, the paper's
/// figure as a diamond.
pub fn bars(table: &SuccessTable) -> Result<String> {
    let rows: Vec<_> = table.rows.iter().filter(|row| !row.cells.is_empty() || row.paper.is_some()).collect();
    let label = |labels: &[String]| -> String {
        let parts = table.label_heads.iter().zip(labels);
        parts.map(|(head, label)| format!("{head} {label}")).collect::<Vec<_>>().join(", ")
    };
    let entries: Vec<Entry> = rows.iter().enumerate().map(|(k, row)| (label(&row.labels), ink(k))).collect();
    sheet((WIDTH, 490 + legend_height(&entries, WIDTH)), |area| {
        let (strip, rest) = area.split_vertically(TITLE);
        title(&strip, &table.title)?;
        let (head, body) = rest.split_vertically(legend_height(&entries, WIDTH));
        legend(&head, &entries)?;
        let n_crowds = CrowdKind::PAPER.len();
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
        for (crowd_idx, crowd) in CrowdKind::PAPER.into_iter().enumerate() {
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
        for (index, crowd) in CrowdKind::PAPER.into_iter().enumerate() {
            let x = left + (f64::from(right - left) * (index as f64 + 0.5) / n_crowds as f64) as i32;
            area.draw_text(crowd.name(), &centred(15, &DARK, VPos::Top), (x, foot + 6))?;
        }
        let note = "bars: ours, with 95 % Wilson intervals; diamonds: the paper's figures";
        area.draw_text(note, &centred(12, &GREY, VPos::Top), (i32::midpoint(left, right), foot + 30))?;
        Ok(())
    })
}
