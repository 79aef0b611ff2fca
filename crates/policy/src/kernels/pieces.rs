//! Division of work over threads without allocation: slices that are cut in pieces, side by side.

/// Calls `work(i, pieces)` for i in `0..count`, on several threads if there is more than one piece.
///
/// `pieces` are the i-th pieces of all slices; a slice comes with the length of its pieces, the last of which may be
/// shorter. A single piece stays on the calling thread: handing it over would cost more than a small inference. Which
/// thread does which piece does not matter to the result, as each writes its own pieces alone.
pub(crate) fn for_each_piece<const N: usize>(
    count: usize,
    slices: [(&mut [f32], usize); N],
    work: &(impl Fn(usize, [&mut [f32]; N]) + Sync),
) {
    divide(0, count, slices, work);
}

fn divide<const N: usize>(
    first: usize,
    count: usize,
    mut slices: [(&mut [f32], usize); N],
    work: &(impl Fn(usize, [&mut [f32]; N]) + Sync),
) {
    match count {
        0 => {}
        1 => work(
            first,
            slices.map(|(slice, len)| {
                let end = len.min(slice.len());
                &mut slice[..end]
            }),
        ),
        _ => {
            let half = count / 2;
            let behind = slices.each_mut().map(|(slice, len)| {
                let whole = std::mem::take(slice);
                let at = (half * *len).min(whole.len());
                let (front, behind) = whole.split_at_mut(at);
                *slice = front;
                (behind, *len)
            });
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
            let (mut a, mut b) = (vec![0.0; len], vec![0.0; 2 * count]);
            for_each_piece(count, [(&mut a, 3), (&mut b, 2)], &|idx, [a, b]| {
                for value in a {
                    *value += 1.0 + idx as f32;
                }
                for value in b {
                    *value -= 1.0 + idx as f32;
                }
            });
            let expected = |idx: usize| 1.0 + idx as f32;
            assert!(
                a.iter().take(3 * count).enumerate().all(|(at, value)| *value == expected(at / 3)),
                "{a:?}"
            );
            assert!(b.iter().enumerate().all(|(at, value)| *value == -expected(at / 2)), "{b:?}");
        }
    }
}
