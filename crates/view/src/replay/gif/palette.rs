//! The colours of a GIF: the ones that cover most of its pictures, but none too near to another.

use std::collections::BTreeMap;

use tiny_skia::Pixmap;

/// Colours; the last index of the 64 is the transparent one.
const COLOURS: usize = 63;
/// The index of a pixel that stays as it was.
pub(super) const TRANSPARENT: u8 = COLOURS as u8;
/// Least squared distance of two colours (8 bits a channel).
const APART: i32 = 200;

type Rgb = [u8; 3];

/// Colours, with what was looked up so far.
pub(super) struct Palette {
    colours: Vec<Rgb>,
    known: BTreeMap<Rgb, u8>,
}

impl Palette {
    /// The palette of these pictures.
    pub(super) fn from_pictures<'a>(pictures: impl Iterator<Item = &'a Pixmap>) -> Self {
        let mut counts: BTreeMap<Rgb, u64> = BTreeMap::new();
        for picture in pictures {
            let mut run: (Rgb, u64) = ([0; 3], 0);
            for colour in colours(picture) {
                if colour != run.0 {
                    *counts.entry(run.0).or_default() += run.1;
                    run = (colour, 0);
                }
                run.1 += 1;
            }
            *counts.entry(run.0).or_default() += run.1;
        }
        let mut by_count: Vec<(Rgb, u64)> = counts.into_iter().filter(|(_, count)| *count > 0).collect();
        // Stable: of colours as frequent as one another, the darker first.
        by_count.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let mut chosen: Vec<Rgb> = Vec::with_capacity(COLOURS);
        for (colour, _) in by_count {
            if chosen.len() < COLOURS && chosen.iter().all(|other| distance(*other, colour) >= APART) {
                chosen.push(colour);
            }
        }
        Self { colours: chosen, known: BTreeMap::new() }
    }

    /// Red, green and blue of each index, the transparent one's among them.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut all = self.colours.clone();
        all.resize(COLOURS + 1, [0; 3]);
        all.into_flattened()
    }

    /// The index of each pixel's nearest colour, row by row.
    pub(super) fn indices(&mut self, picture: &Pixmap) -> Vec<u8> {
        let mut last = ([0; 3], self.nearest([0; 3]));
        let index = |colour| {
            if colour != last.0 {
                last = (colour, self.nearest(colour));
            }
            last.1
        };
        colours(picture).map(index).collect()
    }

    fn nearest(&mut self, colour: Rgb) -> u8 {
        let colours = &self.colours;
        *self.known.entry(colour).or_insert_with(|| {
            let nearest = (0..colours.len()).min_by_key(|k| distance(colours[*k], colour));
            nearest.unwrap_or(0) as u8
        })
    }
}

/// The pixels of a picture without holes.
fn colours(picture: &Pixmap) -> impl Iterator<Item = Rgb> {
    picture.pixels().iter().map(|pixel| [pixel.red(), pixel.green(), pixel.blue()])
}

fn distance(a: Rgb, b: Rgb) -> i32 {
    (0..3).map(|k| (i32::from(a[k]) - i32::from(b[k])).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use tiny_skia::{Color, Paint, Rect, Transform};

    use super::*;

    fn filled(colours: &[(Rgb, f32)]) -> Pixmap {
        let mut picture = Pixmap::new(100, 1).unwrap();
        let mut left = 0.0;
        for (colour, width) in colours {
            let mut paint = Paint::default();
            let [red, green, blue] = *colour;
            paint.set_color(Color::from_rgba8(red, green, blue, 255));
            let part = Rect::from_xywh(left, 0.0, *width, 1.0).unwrap();
            picture.fill_rect(part, &paint, Transform::identity(), None);
            left += width;
        }
        picture
    }

    #[test]
    fn frequent_colours_come_first_and_their_neighbours_are_theirs() {
        let (white, red, pink, blue) = ([255; 3], [200, 0, 0], [205, 5, 5], [0, 0, 200]);
        let picture = filled(&[(white, 50.0), (pink, 10.0), (red, 20.0), (blue, 20.0)]);
        let mut palette = Palette::from_pictures([&picture].into_iter());
        // Blue is darker than red and as frequent; pink is nearer to red than two colours may be.
        assert_eq!(palette.colours, [white, blue, red]);
        let indices = palette.indices(&picture);
        assert_eq!([0, 49, 50, 60, 99].map(|at| indices[at]), [0, 0, 2, 2, 1]);
        assert_eq!(palette.bytes().len(), 192);
    }
}
