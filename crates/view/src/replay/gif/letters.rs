//! Words on a picture, in a bitmap font of one size: no font of this system has a part in it.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use tiny_skia::{Color, Pixmap, PremultipliedColorU8};

const WEIGHT: FontWeight = FontWeight::Regular;
const SIZE: RasterHeight = RasterHeight::Size16;
/// Height of a line (pixels).
pub(super) const HEIGHT: u32 = SIZE.val() as u32;

/// Width of a text (pixels).
pub(super) fn width(text: &str) -> u32 {
    (text.chars().count() * get_raster_width(WEIGHT, SIZE)) as u32
}

/// The longest beginning of a text that is at most so wide.
pub(super) fn fitting(text: &str, pixels: u32) -> String {
    text.chars().take(pixels as usize / get_raster_width(WEIGHT, SIZE)).collect()
}

/// Writes a text whose upper left corner is at (x, y); a letter that the font has not becomes a
/// question mark.
pub(super) fn write(picture: &mut Pixmap, text: &str, [x, y]: [u32; 2], ink: Color) {
    let step = get_raster_width(WEIGHT, SIZE) as u32;
    for (k, letter) in text.chars().enumerate() {
        let glyph = get_raster(letter, WEIGHT, SIZE).or_else(|| get_raster('?', WEIGHT, SIZE));
        let Some(glyph) = glyph else { continue };
        for (row, line) in glyph.rows().enumerate() {
            for (column, share) in line.iter().enumerate() {
                cover(picture, [x + k as u32 * step + column as u32, y + row as u32], *share, ink);
            }
        }
    }
}

/// Lays ink over a pixel, `share` of 255 thick.
fn cover(picture: &mut Pixmap, [x, y]: [u32; 2], share: u8, ink: Color) {
    let (wide, tall) = (picture.width(), picture.height());
    if share == 0 || x >= wide || y >= tall {
        return;
    }
    let pixel = &mut picture.pixels_mut()[(y * wide + x) as usize];
    let mix = |below: u8, above: u8| {
        let (below, above, share) = (u32::from(below), u32::from(above), u32::from(share));
        ((below * (255 - share) + above * share + 127) / 255) as u8
    };
    let ink = ink.to_color_u8();
    let channels = [(pixel.red(), ink.red()), (pixel.green(), ink.green()), (pixel.blue(), ink.blue())]
        .map(|(below, above)| mix(below, above));
    let [red, green, blue] = channels;
    *pixel = PremultipliedColorU8::from_rgba(red, green, blue, 255).unwrap_or(*pixel);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_covers_its_own_place_only() {
        let mut picture = Pixmap::new(60, 30).unwrap();
        picture.fill(Color::WHITE);
        write(&mut picture, "é1", [10, 5], Color::BLACK);
        let dark = |x: u32, y: u32| picture.pixel(x, y).unwrap().red() < 128;
        let inside = |x: u32, y: u32| (10..10 + width("é1")).contains(&x) && (5..5 + HEIGHT).contains(&y);
        let all = || (0..30).flat_map(|y| (0..60).map(move |x| (x, y)));
        assert!(all().any(|(x, y)| dark(x, y)));
        assert!(all().all(|(x, y)| inside(x, y) || !dark(x, y)));
        assert_eq!(fitting("strong-seed1", width("strong")), "strong");
    }
}
