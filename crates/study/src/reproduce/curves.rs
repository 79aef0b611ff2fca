//! Figure "loss": losses of both discriminators and the intrinsic reward against updates, from the
//! shipped curves.

use anyhow::{Context as _, Result, ensure};
use jostle_eval::report::grid::csv_line;

use super::Figure;
use jostle_view::curves::{Axis, Curve, Panel, Panels};
use jostle_view::draw;

/// The row whose training is shown.
pub(super) const VARIANT: &str = "m5";
/// The figure's columns, by their names in a curve's file.
const COLUMNS: [&str; 3] = ["loss_state_action", "loss_state", "intrinsic_reward"];

/// A measure of all seeds: update, mean, least, greatest.
type Points = Vec<[f64; 4]>;

/// The figure of a variant with so many behaviours; `None` where no run is there.
pub(super) fn figure(curves: &[(u64, String)], n_behaviours: usize) -> Result<Option<Figure>> {
    if curves.is_empty() {
        return Ok(None);
    }
    let columns: Vec<Points> = COLUMNS.iter().map(|name| points(curves, name)).collect::<Result<_>>()?;
    Ok(Some(Figure {
        csv: csv(&columns),
        svg: draw::panels::curves(&panels(columns, curves.len(), n_behaviours))?,
    }))
}

fn csv(columns: &[Points]) -> String {
    let mut csv = csv_line(["update".to_owned()].into_iter().chain(
        COLUMNS.iter().flat_map(|name| ["mean", "least", "greatest"].map(|what| format!("{name}_{what}"))),
    ));
    for i in 0..columns[0].len() {
        let update = format!("{}", columns[0][i][0]);
        let values =
            columns.iter().flat_map(|points| points[i][1..].iter().map(|value| format!("{value:.5e}")));
        csv += &csv_line([update].into_iter().chain(values));
    }
    csv
}

/// Both losses in one panel, as in the paper, with the loss of a guess as a dotted line; the reward
/// in another.
fn panels(columns: Vec<Points>, n_seeds: usize, n_behaviours: usize) -> Panels {
    let updates = columns[0].last().map_or(0.0, |point| point[0]) as usize;
    let label = match n_seeds {
        1 => format!("M = {n_behaviours}, one training seed"),
        n => format!("M = {n_behaviours}, {n} training seeds: mean, and from the least to the greatest"),
    };
    let mut curves = columns.into_iter().enumerate().map(|(column, points)| Curve {
        group: 0,
        dashed: column == 1,
        points,
    });
    let losses = curves.by_ref().take(2).collect();
    let panel = |title: &str, level, curves| Panel {
        title: title.to_owned(),
        range: None,
        levels: vec![level],
        curves,
        empty: "no curve",
    };
    let loss = "Discriminator loss (nats): q(z|s,a) solid, q(z|s) dashed";
    let panels = vec![
        panel(loss, (n_behaviours as f64).ln(), losses),
        panel("Intrinsic reward of a step, before α", 0.0, curves.collect()),
    ];
    Panels { labels: vec![label], panels, axis: Axis::Updates(updates) }
}

/// A column of all curves, window by window as far as all of them go.
fn points(curves: &[(u64, String)], column: &str) -> Result<Points> {
    let series: Vec<Vec<(f64, f64)>> = curves
        .iter()
        .map(|(seed, csv)| read(csv, column).with_context(|| format!("curve of seed {seed}")))
        .collect::<Result<_>>()?;
    let shortest = series.iter().map(Vec::len).min().unwrap_or(0);
    (0..shortest)
        .map(|i| {
            let update = series[0][i].0;
            let values: Vec<f64> = series.iter().map(|points| points[i].1).collect();
            ensure!(
                series.iter().all(|points| points[i].0 == update),
                "the curves have windows of different width"
            );
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            Ok([update, mean, least, greatest])
        })
        .collect()
}

/// Updates and values of a column.
fn read(csv: &str, column: &str) -> Result<Vec<(f64, f64)>> {
    let mut lines = csv.lines();
    let heads: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let index =
        |name: &str| heads.iter().position(|head| *head == name).with_context(|| format!("no column {name}"));
    let (update, value) = (index("update")?, index(column)?);
    lines
        .enumerate()
        .map(|(i, line)| {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |at: usize| -> Result<f64> {
                let field = fields.get(at).copied().unwrap_or_default();
                field.parse().with_context(|| format!("line {}: found {field:?}, expected a number", i + 2))
            };
            Ok((number(update)?, number(value)?))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_has_both_losses_and_the_reward() {
        let csv =
            "update,loss_state_action,loss_state,intrinsic_reward\n10,1.6,1.6,0\n20,1.2,1.4,0.2\n".to_owned();
        let figure = figure(&[(1, csv)], 5).unwrap().unwrap();
        assert!(figure.csv.starts_with("update,loss_state_action_mean,") && figure.csv.lines().count() == 3);
        assert!(figure.svg.contains("M = 5, one training seed") && figure.svg.contains("Intrinsic reward"));
        assert!(super::figure(&[], 5).unwrap().is_none());
    }

    #[test]
    fn seeds_become_a_band() {
        let csv = |a: f64| format!("update,loss_state\n10,{a}\n20,{}\n", a + 1.0);
        let band = points(&[(1, csv(1.0)), (2, csv(3.0))], "loss_state").unwrap();
        assert_eq!(band, [[10.0, 2.0, 1.0, 3.0], [20.0, 3.0, 2.0, 4.0]]);
        assert!(points(&[(1, csv(1.0))], "loss").is_err());
        assert!(read("update,loss_state\n10,x\n", "loss_state").unwrap_err().to_string().contains("line 2"));
    }
}
