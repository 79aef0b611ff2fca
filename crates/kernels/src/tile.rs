//! Rows of an output in tiles of nearly one size.

/// The sizes of the tiles: as few tiles as fit, none more than one row larger than another.
///
/// 64 rows in tiles of at most 14 are 13 + 13 + 13 + 13 + 12, not 14 + 14 + 14 + 14 + 8: a small
/// tile leaves the multiply-add units waiting for loads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tiles {
    /// Rows of the smaller tiles.
    pub(crate) small: usize,
    /// Number of tiles with one row more; they come first.
    pub(crate) n_large: usize,
    /// Number of tiles.
    pub(crate) count: usize,
}

impl Tiles {
    /// Splits `rows` > 0.
    pub(crate) fn new(rows: usize, largest: usize) -> Self {
        let count = rows.div_ceil(largest);
        Self { small: rows / count, n_large: rows % count, count }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_rows() {
        for rows in 1..200 {
            let tiles = Tiles::new(rows, 14);
            assert_eq!(tiles.count * tiles.small + tiles.n_large, rows);
            assert!(tiles.small + usize::from(tiles.n_large > 0) <= 14);
        }
    }
}
