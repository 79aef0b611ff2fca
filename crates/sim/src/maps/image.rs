//! Images of occupancy grids: PGM and PPM (`P2`, `P3`, `P5`, `P6`) by a reader of our own, PNG
//! through the crate `png` (feature `png`). Every depth that these formats have is read in full;
//! nothing is rounded to 8 bits.

use super::read;
use crate::error::SimError;
use std::path::Path;

/// Most cells along either side.
const SIDE_MAX: usize = 4096;

/// A pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixel {
    /// Sum of red, green and blue, each 0 to 1; of a grey pixel three times its brightness.
    pub(super) colours: f64,
    /// Opacity, 0 to 1, where the image has it.
    pub(super) alpha: Option<f64>,
}

/// The answers of a function about every pixel, row by row from the top.
#[derive(Debug)]
pub(super) struct Cells {
    pub(super) width: usize,
    pub(super) cells: Vec<bool>,
}

/// Reads an image by its first bytes and asks `about` for each pixel.
pub(super) fn load(path: &Path, about: impl Fn(Pixel) -> bool) -> Result<Cells, SimError> {
    let bytes = read(path)?;
    match bytes.get(..2) {
        Some([b'P', kind @ (b'2' | b'3' | b'5' | b'6')]) => {
            let samples = if matches!(kind, b'3' | b'6') { 3 } else { 1 };
            Pnm { path, bytes: &bytes, at: 2 }.image(samples, *kind >= b'5', &about)
        }
        #[cfg(feature = "png")]
        Some([0x89, b'P']) => png_image(path, &bytes, &about),
        #[cfg(not(feature = "png"))]
        Some([0x89, b'P']) => Err(SimError::feature(path, "png")),
        _ => {
            let expected = "a PGM (P2, P5), PPM (P3, P6) or PNG image";
            Err(SimError::file(path, "first bytes", "something else", expected))
        }
    }
}

fn check_size(path: &Path, width: usize, height: usize) -> Result<(), SimError> {
    if (1..=SIDE_MAX).contains(&width) && (1..=SIDE_MAX).contains(&height) {
        return Ok(());
    }
    let expected = format!("1 to {SIDE_MAX} cells along each side");
    Err(SimError::file(path, "size", format!("{width} by {height}"), expected))
}

/// The cells of samples that are stored one after another: 1 or 3 colours for a pixel, perhaps an
/// opacity behind them.
fn cells(
    width: usize,
    samples: usize,
    values: impl Iterator<Item = f64>,
    about: &impl Fn(Pixel) -> bool,
) -> Cells {
    let n_colours = if samples >= 3 { 3 } else { 1 };
    let (mut cells, mut sum, mut at) = (Vec::new(), 0.0, 0);
    for value in values {
        at += 1;
        let is_alpha = at > n_colours;
        if !is_alpha {
            sum += value;
        }
        if at == samples {
            let colours = if n_colours == 1 { 3.0 * sum } else { sum };
            cells.push(about(Pixel { colours, alpha: is_alpha.then_some(value) }));
            (sum, at) = (0.0, 0);
        }
    }
    Cells { width, cells }
}

/// The cells of grey pixels of one byte.
fn grey_bytes(width: usize, data: &[u8], largest: usize, about: &impl Fn(Pixel) -> bool) -> Cells {
    let grey = |value: u16| Pixel { colours: 3.0 * (f64::from(value) / largest as f64), alpha: None };
    let answers: Vec<bool> = (0..=0xFF).map(|value| about(grey(value))).collect();
    Cells { width, cells: data.iter().map(|byte| answers[usize::from(*byte)]).collect() }
}

/// A PGM or PPM file that is being read.
struct Pnm<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl Pnm<'_> {
    fn image(
        mut self,
        samples: usize,
        binary: bool,
        about: &impl Fn(Pixel) -> bool,
    ) -> Result<Cells, SimError> {
        let (width, height) = (self.number("width")?, self.number("height")?);
        check_size(self.path, width, height)?;
        let largest = self.number("maximum")?;
        if !(1..=0xFFFF).contains(&largest) {
            return Err(SimError::file(self.path, "maximum", largest, "1 to 65535"));
        }
        let n = width * height * samples;
        if binary && samples == 1 && largest <= 0xFF {
            return self.grey_bytes(width, n, largest, about);
        }
        let raw = if binary { self.binary(n, largest)? } else { self.decimal(n)? };
        if let Some(sample) = raw.iter().find(|sample| usize::from(**sample) > largest) {
            return Err(SimError::file(self.path, "pixel", sample, format!("at most {largest}")));
        }
        let scaled = raw.iter().map(|sample| f64::from(*sample) / largest as f64);
        Ok(cells(width, samples, scaled, about))
    }

    /// The frequent kind: 16 million cells have 256 kinds of pixels.
    fn grey_bytes(
        &self,
        width: usize,
        n: usize,
        largest: usize,
        about: &impl Fn(Pixel) -> bool,
    ) -> Result<Cells, SimError> {
        let data = self.data(n)?;
        if let Some(sample) = data.iter().find(|sample| usize::from(**sample) > largest) {
            return Err(SimError::file(self.path, "pixel", sample, format!("at most {largest}")));
        }
        Ok(grey_bytes(width, data, largest, about))
    }

    /// The bytes behind the header. What follows them is another image or a line's end.
    fn data(&self, expected: usize) -> Result<&[u8], SimError> {
        // One white space byte ends the header.
        let data = self.bytes.get(self.at + 1..).unwrap_or_default();
        data.get(..expected).ok_or_else(|| {
            let found = format!("{} bytes", data.len());
            SimError::file(self.path, "pixels", found, expected.to_string())
        })
    }

    /// Samples of one byte, or of two, the higher first, where the largest does not fit into one.
    fn binary(&self, n: usize, largest: usize) -> Result<Vec<u16>, SimError> {
        if largest > 0xFF {
            let pairs = self.data(2 * n)?.chunks_exact(2);
            return Ok(pairs.map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect());
        }
        Ok(self.data(n)?.iter().copied().map(u16::from).collect())
    }

    fn decimal(&mut self, n: usize) -> Result<Vec<u16>, SimError> {
        let mut sample = |_| {
            let sample = self.number("pixel")?;
            let too_light = |_| SimError::file(self.path, "pixel", sample, "at most 65535");
            u16::try_from(sample).map_err(too_light)
        };
        (0..n).map(&mut sample).collect()
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

#[cfg(feature = "png")]
fn png_image(path: &Path, bytes: &[u8], about: &impl Fn(Pixel) -> bool) -> Result<Cells, SimError> {
    let refused = |error: png::DecodingError| SimError::file(path, "PNG", error, "a valid PNG image");
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    // Palettes become colours, a transparent colour becomes opacity, and less than 8 bits become 8.
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(refused)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_size(path, width, height)?;
    // Found by fuzzing: png 0.18 panics on a palette with a part of a colour.
    if let Some(palette) = reader.info().palette.as_ref().filter(|palette| !palette.len().is_multiple_of(3)) {
        let found = format!("{} bytes", palette.len());
        return Err(SimError::file(path, "palette", found, "three for each colour"));
    }
    // At most four samples of two bytes a pixel after the transformation.
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or(8 * width * height)];
    let info = reader.next_frame(&mut pixels).map_err(refused)?;
    let (samples, pixels) = (info.color_type.samples(), &pixels[..info.buffer_size()]);
    if samples == 1 && info.bit_depth == png::BitDepth::Eight {
        return Ok(grey_bytes(width, pixels, 0xFF, about));
    }
    Ok(if info.bit_depth == png::BitDepth::Sixteen {
        let wide = |pair: &[u8]| f64::from(u16::from_be_bytes([pair[0], pair[1]])) / 65535.0;
        cells(width, samples, pixels.chunks_exact(2).map(wide), about)
    } else {
        cells(width, samples, pixels.iter().map(|byte| f64::from(*byte) / 255.0), about)
    })
}
