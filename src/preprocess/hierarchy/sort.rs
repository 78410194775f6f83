//! Least significant digit radix sort, stable and parallel: M. Zagha and G. E. Blelloch, "Radix Sort for Vector
//! Multiprocessors", 1991; the counterpart on the CPU of Ha et al. 2009, which Sabbadin 2019, 5.1 uses.

use rayon::prelude::*;

/// Values of one digit of 11 bits: six passes over a Morton code. Eight passes of 8 bits, whose write heads fit the TLB
/// better, take a fifth longer.
const RADIX: usize = 2048;

/// Chunks of one pass. More than the threads of a usual machine, so that a late thread delays little; the result
/// does not depend on it, because the sort is stable.
const CHUNKS: usize = 16;

/// A chunk is worth its counts and heads from about this many items on.
const LEAST_CHUNK: usize = 1 << 14;

/// A Morton code and the point that it belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Keyed {
    pub(super) key: u64,
    pub(super) index: u32,
}

/// Sorts by key; equal keys keep their order. Allocates as much again as `items` holds.
pub(super) fn sort(mut items: Vec<Keyed>) -> Vec<Keyed> {
    let mut other = vec![Keyed::default(); items.len()];

    // Bits in which not all keys agree: a digit without any would only copy.
    let first = items.first().map_or(0, |item| item.key);
    let differing = items.par_iter().map(|item| item.key ^ first).reduce(|| 0, |a, b| a | b);

    for shift in (0..u64::BITS).step_by(RADIX.trailing_zeros() as usize) {
        if differing >> shift & (RADIX as u64 - 1) != 0 {
            pass(&items, &mut other, shift);
            std::mem::swap(&mut items, &mut other);
        }
    }
    items
}

/// The digit of `key` that starts at bit `shift`.
fn digit(key: u64, shift: u32) -> usize {
    (key >> shift) as usize & (RADIX - 1)
}

/// One pass: `to` becomes `from` in the order of one digit.
fn pass(from: &[Keyed], to: &mut [Keyed], shift: u32) {
    // Count each chunk's digits.
    let chunk = from.len().div_ceil(CHUNKS).max(LEAST_CHUNK);
    let counts: Vec<[u32; RADIX]> = from
        .par_chunks(chunk)
        .map(|items| {
            let mut counts = [0; RADIX];
            for item in items {
                counts[digit(item.key, shift)] += 1;
            }
            counts
        })
        .collect();

    // Hand each chunk its own piece of every digit's bucket: digit by digit, within a digit chunk by chunk.
    let mut heads: Vec<Vec<std::slice::IterMut<Keyed>>> = counts.iter().map(|_| Vec::with_capacity(RADIX)).collect();
    let mut rest = to;
    for digit in 0..RADIX {
        for (heads, counts) in heads.iter_mut().zip(&counts) {
            let (piece, after) = rest.split_at_mut(counts[digit] as usize);
            heads.push(piece.iter_mut());
            rest = after;
        }
    }

    // Scatter; a head cannot run out, because it holds exactly what was counted.
    from.par_chunks(chunk).zip(heads).for_each(|(items, mut heads)| {
        for item in items {
            if let Some(place) = heads[digit(item.key, shift)].next() {
                *place = *item;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn keyed(keys: &[u64]) -> Vec<Keyed> {
        keys.iter().zip(0..).map(|(&key, index)| Keyed { key, index }).collect()
    }

    #[test]
    fn chunks_keep_the_order_of_equal_keys() {
        // Three chunks; neighbours differ in the highest digit and in the lowest.
        let keys: Vec<u64> = (0..LEAST_CHUNK as u64 * 5 / 2).map(|i| ((i * 7 % 5) << 60) | (i * 31 % 11)).collect();
        let mut expected = keyed(&keys);
        expected.sort_by_key(|item| item.key);
        assert_eq!(sort(keyed(&keys)), expected);
    }

    #[test]
    fn every_single_bit_counts() {
        for bit in 0..64 {
            let (low, high) = (7 & !(1 << bit), 7 | 1 << bit);
            let sorted = sort(keyed(&[high, low, high, low]));
            assert_eq!(sorted.iter().map(|item| item.index).collect::<Vec<_>>(), [1, 3, 0, 2], "bit {bit}");
        }
    }

    proptest! {
        #![proptest_config(super::super::seeded())]

        #[test]
        fn agrees_with_the_stable_sort_of_the_standard_library(
            keys in prop::collection::vec(prop_oneof![any::<u64>(), 0..4u64, (0..9u64).prop_map(|k| k << 61)], 0..500),
        ) {
            let mut expected = keyed(&keys);
            expected.sort_by_key(|item| item.key);
            prop_assert_eq!(sort(keyed(&keys)), expected);
        }
    }
}
