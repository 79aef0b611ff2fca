//! Grey images of occupancy grids: PGM (`P2`, `P5`) by a reader of our own, PNG through the crate `png`.

use super::read;
use crate::error::SimError;
use std::io::Cursor;
use std::path::Path;

/// Most cells along either side.
const SIDE_MAX: usize = 4096;

/// Brightness of every cell, 0 to 255, row by row from the top.
#[derive(Debug)]
pub(super) struct GreyImage {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) grey: Vec<u8>,
}

/// Reads an image by its first bytes.
pub(super) fn load(path: &Path) -> Result<GreyImage, SimError> {
    let bytes = read(path)?;
    match bytes.get(..2) {
        Some(b"P2" | b"P5") => Pgm { path, bytes: &bytes, at: 2 }.image(bytes[1] == b'5'),
        Some([0x89, b'P']) => png_image(path, &bytes),
        _ => Err(SimError::file(path, "first bytes", "something else", "a PGM (P2, P5) or PNG image")),
    }
}

fn check_size(path: &Path, width: usize, height: usize) -> Result<(), SimError> {
    if (1..=SIDE_MAX).contains(&width) && (1..=SIDE_MAX).contains(&height) {
        return Ok(());
    }
    let expected = format!("1 to {SIDE_MAX} cells along each side");
    Err(SimError::file(path, "size", format!("{width} by {height}"), expected))
}

/// A PGM file that is being read.
struct Pgm<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl Pgm<'_> {
    fn image(mut self, binary: bool) -> Result<GreyImage, SimError> {
        let (width, height) = (self.number("width")?, self.number("height")?);
        check_size(self.path, width, height)?;
        let largest = self.number("maximum")?;
        if !(1..=255).contains(&largest) {
            return Err(SimError::file(self.path, "maximum", largest, "1 to 255"));
        }
        let n = width * height;
        let raw: Vec<u8> = if binary {
            // One white space byte ends the header.
            let data = self.bytes.get(self.at + 1..).unwrap_or_default();
            if data.len() != n {
                return Err(SimError::file(
                    self.path,
                    "pixels",
                    format!("{} bytes", data.len()),
                    n.to_string(),
                ));
            }
            data.to_vec()
        } else {
            (0..n)
                .map(|_| {
                    let pixel = self.number("pixel")?;
                    let too_light =
                        |_| SimError::file(self.path, "pixel", pixel, format!("at most {largest}"));
                    u8::try_from(pixel).map_err(too_light)
                })
                .collect::<Result<_, _>>()?
        };
        if let Some(pixel) = raw.iter().find(|pixel| usize::from(**pixel) > largest) {
            return Err(SimError::file(self.path, "pixel", pixel, format!("at most {largest}")));
        }
        let grey = raw.into_iter().map(|x| (usize::from(x) * 255 / largest) as u8).collect();
        Ok(GreyImage { width, height, grey })
    }

    /// The next decimal number, after white space and comments.
    fn number(&mut self, field: &str) -> Result<usize, SimError> {
        while let Some(byte) = self.bytes.get(self.at) {
            match byte {
                b'#' => {
                    let rest = &self.bytes[self.at..];
                    self.at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
                }
                b if b.is_ascii_whitespace() => self.at += 1,
                _ => break,
            }
        }
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        self.at += digits;
        // Nine digits are more than any field may have; longer ones would not be read whole.
        let text = str::from_utf8(&rest[..digits]).ok().filter(|text| text.len() <= 9);
        text.and_then(|text| text.parse().ok()).ok_or_else(|| {
            let found = match rest.first() {
                _ if digits > 0 => format!("a number of {digits} digits"),
                Some(byte) => format!("byte {byte}"),
                None => "the end of the file".into(),
            };
            SimError::file(self.path, field, found, "a decimal number of at most 9 digits")
        })
    }
}

fn png_image(path: &Path, bytes: &[u8]) -> Result<GreyImage, SimError> {
    let refused = |error: png::DecodingError| SimError::file(path, "PNG", error, "a valid PNG image");
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(refused)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_size(path, width, height)?;
    // Found by fuzzing: png 0.18 panics on a palette with a part of a colour.
    if let Some(palette) = reader.info().palette.as_ref().filter(|palette| !palette.len().is_multiple_of(3)) {
        return Err(SimError::file(
            path,
            "palette",
            format!("{} bytes", palette.len()),
            "three for each colour",
        ));
    }
    // At most four bytes a pixel after the transformation.
    let mut pixels = vec![0; 4 * width * height];
    let info = reader.next_frame(&mut pixels).map_err(refused)?;
    let samples = info.color_type.samples();
    let colours = if samples >= 3 { 3 } else { 1 };
    let mean =
        |pixel: &[u8]| (pixel[..colours].iter().map(|c| usize::from(*c)).sum::<usize>() / colours) as u8;
    let grey = pixels[..info.buffer_size()].chunks_exact(samples).map(mean).collect();
    Ok(GreyImage { width, height, grey })
}
