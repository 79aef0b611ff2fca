//! The page: one file without links, as the replay's.

use crate::replay::page::{PARTS, SCENE, STYLE, fill};

const TEMPLATE: &str = include_str!("page.html");
const OWN_STYLE: &str = include_str!("live.css");
const LIVE: &str = include_str!("live.js");

/// The whole page.
pub(crate) fn page() -> String {
    let style = format!("{STYLE}{OWN_STYLE}");
    fill(TEMPLATE, &[("style", &style), ("scene", SCENE), ("parts", PARTS), ("live", LIVE)])
}
