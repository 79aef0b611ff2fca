//! The data of a study: rows (training settings), their training seeds, and the episodes of each at
//! each site.

use std::collections::BTreeMap;

use jostle_eval::compact::CompactEpisode;

/// A policy of one training seed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeedRun {
    /// Training seed.
    pub seed: u64,
    /// Episodes by site: a crowd's two letters or a map's name. Episode k is the same for every
    /// policy.
    pub sites: BTreeMap<String, Vec<CompactEpisode>>,
    /// The diversity metric D, where it was measured.
    pub diversity: Option<f64>,
}

/// A row of a table: one training setting at one length, with its seeds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Its policies, by training seed.
    pub seeds: Vec<SeedRun>,
    /// Updates done and updates of the row, where training was shorter than the row says.
    pub shorter: Option<(u64, u64)>,
}

/// All rows by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Study {
    /// Rows; one without seeds counts as missing.
    pub rows: BTreeMap<String, Row>,
}

impl Study {
    /// The seeds of a row; none where it is missing.
    pub fn seeds(&self, row: &str) -> &[SeedRun] {
        self.rows.get(row).map_or(&[], |row| &row.seeds)
    }
}
