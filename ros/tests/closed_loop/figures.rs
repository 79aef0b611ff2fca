//! The figures of a drive, and a picture of it.

use std::fmt::Write as _;

use crate::log::{Entry, commands};

/// Latency and losses of a drive.
#[derive(Clone, Debug)]
pub(crate) struct Figures {
    /// From before a scan is published until the command that answers it is received, in the peer,
    /// s.
    pub(crate) median: f64,
    pub(crate) p95: f64,
    /// Scans between the first and the last that was answered, and how many of them were not.
    pub(crate) scans: usize,
    pub(crate) unanswered: usize,
    /// Messages that the node received, and gaps in their numbers.
    pub(crate) received: usize,
    pub(crate) lost_in: usize,
    seconds: f64,
}

impl Figures {
    pub(crate) fn new(entries: &[Entry], said: &str) -> Self {
        let scans: Vec<i64> = entries.iter().filter(|e| e.event == "scan").map(|e| e.sent).collect();
        let answers: Vec<Option<f64>> = scans
            .iter()
            .map(|stamp| {
                commands(entries).find(|c| c.stamp == *stamp).map(|c| (c.sent - stamp) as f64 * 1e-9)
            })
            .collect();
        let first = answers.iter().position(Option::is_some).expect("a scan that was answered");
        let last = answers.iter().rposition(Option::is_some).expect("a scan that was answered");
        let mut latencies: Vec<f64> = answers.iter().flatten().copied().collect();
        latencies.sort_by(f64::total_cmp);
        let at = |share: f64| latencies[((latencies.len() - 1) as f64 * share).round() as usize];
        let counts =
            said.lines().rev().find_map(|line| line.strip_prefix("jostle-ros: received ")).expect(said);
        let numbers: Vec<usize> = counts
            .split(|c: char| !c.is_ascii_digit())
            .filter(|text| !text.is_empty())
            .map(|text| text.parse().expect("a number"))
            .collect();
        Self {
            median: at(0.5),
            p95: at(0.95),
            scans: last - first + 1,
            unanswered: answers[first..=last].iter().filter(|answer| answer.is_none()).count(),
            received: numbers[0] + numbers[2] + numbers[4],
            lost_in: numbers[1] + numbers[3] + numbers[5],
            seconds: (scans[last] - scans[first]) as f64 * 1e-9,
        }
    }

    /// A row of the page's table.
    pub(crate) fn row(&self, peer: &str) -> String {
        let Self { median, p95, scans, unanswered, received, lost_in, seconds } = self;
        format!(
            "| {peer} | {seconds:.1} | {:.1} | {:.1} | {lost_in} of {received} | {unanswered} of {scans} |",
            median * 1e3,
            p95 * 1e3
        )
    }
}

/// The robot's way through the room, seen from above, as SVG.
pub(crate) fn picture(entries: &[Entry]) -> String {
    let scans: Vec<&Entry> = entries.iter().filter(|entry| entry.event == "scan").collect();
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"-5.3 -5.3 10.6 10.6\" width=\"480\" height=\"480\" \
         font-family=\"sans-serif\" font-size=\"0.32\">\n\
         <rect x=\"-5.3\" y=\"-5.3\" width=\"10.6\" height=\"10.6\" fill=\"white\"/>\n\
         <rect x=\"-5\" y=\"-5\" width=\"10\" height=\"10\" fill=\"none\" stroke=\"#333\" stroke-width=\"0.08\"/>\n",
    );
    // y points up.
    let last = scans.last().expect("a scan");
    let n_discs = last.discs.len();
    for [x, y, radius] in &last.discs[..n_discs - 1] {
        let _ = writeln!(svg, "<circle cx=\"{x:.2}\" cy=\"{:.2}\" r=\"{radius:.2}\" fill=\"#888\"/>", -y);
    }
    for scan in scans.iter().step_by(10) {
        let [x, y, radius] = scan.discs[n_discs - 1];
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.2}\" cy=\"{:.2}\" r=\"{radius:.2}\" fill=\"none\" stroke=\"#c60\" stroke-width=\"0.03\"/>",
            -y
        );
        let _ =
            writeln!(svg, "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"0.09\" fill=\"#06c\"/>", scan.x, -scan.y);
    }
    let way: Vec<String> = scans.iter().map(|scan| format!("{:.2},{:.2}", scan.x, -scan.y)).collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#06c\" stroke-width=\"0.05\"/>",
        way.join(" ")
    );
    let first = scans[0];
    let _ = writeln!(svg, "<text x=\"{:.2}\" y=\"{:.2}\">start</text>", first.x - 0.3, -first.y + 0.5);
    svg.push_str(
        "<circle cx=\"3.8\" cy=\"-3.2\" r=\"0.5\" fill=\"none\" stroke=\"#080\" stroke-width=\"0.05\"/>\n\
         <text x=\"3.5\" y=\"-3.9\">goal</text>\n</svg>\n",
    );
    svg
}
