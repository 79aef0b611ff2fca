//! Division of work over threads without allocation: slices that are cut in pieces, side by side.

/// Memory that can be cut in pieces: a slice with the length of its pieces, or several of those.
pub trait Pieces: Sized + Send {
    /// One piece.
    type Piece;

    /// Cuts off everything behind the first `pieces` pieces.
    #[must_use]
    fn split_off(&mut self, pieces: usize) -> Self;

    /// The first piece.
    fn first(self) -> Self::Piece;
}

impl<'a, T: Send> Pieces for (&'a mut [T], usize) {
    type Piece = &'a mut [T];

    fn split_off(&mut self, pieces: usize) -> Self {
        let (slice, len) = self;
        let whole = std::mem::take(slice);
        let at = (pieces * *len).min(whole.len());
        let (front, behind) = whole.split_at_mut(at);
        *slice = front;
        (behind, *len)
    }

    fn first(self) -> Self::Piece {
        let (slice, len) = self;
        let end = len.min(slice.len());
        &mut slice[..end]
    }
}

impl<P: Pieces, const N: usize> Pieces for [P; N] {
    type Piece = [P::Piece; N];

    fn split_off(&mut self, pieces: usize) -> Self {
        self.each_mut().map(|part| part.split_off(pieces))
    }

    fn first(self) -> Self::Piece {
        self.map(P::first)
    }
}

impl<A: Pieces, B: Pieces> Pieces for (A, B) {
    type Piece = (A::Piece, B::Piece);

    fn split_off(&mut self, pieces: usize) -> Self {
        (self.0.split_off(pieces), self.1.split_off(pieces))
    }

    fn first(self) -> Self::Piece {
        (self.0.first(), self.1.first())
    }
}

/// Calls `work(i, piece)` for i in `0..count`, on several threads if there is more than one piece.
///
/// `piece` holds the i-th pieces of all slices; a slice comes with the length of its pieces, the
/// last of which may be shorter. A single piece stays on the calling thread: handing it over would
/// cost more than a small inference. Which thread does which piece does not matter to the result,
/// as each writes only its own pieces.
pub fn for_each_piece<P: Pieces>(count: usize, slices: P, work: &(impl Fn(usize, P::Piece) + Sync)) {
    divide(0, count, slices, work);
}

fn divide<P: Pieces>(first: usize, count: usize, mut slices: P, work: &(impl Fn(usize, P::Piece) + Sync)) {
    match count {
        0 => {}
        1 => work(first, slices.first()),
        _ => {
            let half = count / 2;
            let behind = slices.split_off(half);
            rayon::join(
                || divide(first, half, slices, work),
                || divide(first + half, count - half, behind, work),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_comes_once_with_its_number() {
        for (count, len) in [(0, 0), (1, 3), (4, 12), (5, 14), (7, 20)] {
            let (mut a, mut b, mut c) = (vec![0.0; len], vec![0.0; 2 * count], vec![0_u64; count]);
            let slices = ([(&mut a[..], 3), (&mut b[..], 2)], (&mut c[..], 1));
            for_each_piece(count, slices, &|idx, ([a, b], c)| {
                for value in a {
                    *value += 1.0 + idx as f32;
                }
                for value in b {
                    *value -= 1.0 + idx as f32;
                }
                for value in c {
                    *value += 1 + idx as u64;
                }
            });
            let expected = |idx: usize| 1.0 + idx as f32;
            assert!(
                a.iter().take(3 * count).enumerate().all(|(at, value)| *value == expected(at / 3)),
                "{a:?}"
            );
            assert!(b.iter().enumerate().all(|(at, value)| *value == -expected(at / 2)), "{b:?}");
            assert!(c.iter().enumerate().all(|(at, value)| *value == 1 + at as u64), "{c:?}");
        }
    }
}
