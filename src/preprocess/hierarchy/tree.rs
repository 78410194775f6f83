//! Inner nodes of a binary radix tree, all of them independently: T. Karras, "Maximizing Parallelism in the
//! Construction of BVHs, Octrees, and k-d Trees", 2012, section 4.

use rayon::prelude::*;

/// The last leaf of the left child, for every inner node of the radix tree over `keys`; `keys.len() - 1` of them.
///
/// `keys` are strictly increasing. Inner node 0 is the root over all leaves. The children of an inner node with the
/// split `s` over the leaves `first..=last` are inner node `s` over `first..=s` and inner node `s + 1` over
/// `s + 1..=last`; where that is a single leaf it is leaf `s` or `s + 1` instead. So the splits are the whole tree:
/// whoever walks it from the root knows each node's leaves.
pub(super) fn splits(keys: &[u64]) -> Vec<u32> {
    (0..keys.len().saturating_sub(1)).into_par_iter().with_min_len(1 << 12).map(|node| split(keys, node)).collect()
}

/// Karras 2012, Fig. 4, down to line 17: the split position of inner node `i`.
fn split(keys: &[u64], i: usize) -> u32 {
    let i = i as i64;
    // Length of the common prefix of two keys; less than any where there is no second key.
    let key = |j: i64| usize::try_from(j).ok().and_then(|j| keys.get(j));
    let own = keys[i as usize];
    let prefix = |j: i64| key(j).map_or(-1, |other| (own ^ other).leading_zeros() as i32);

    // Direction of the node's range: towards the neighbour with the longer common prefix.
    let (before, after) = (prefix(i - 1), prefix(i + 1));
    let direction = if after > before { 1 } else { -1 };

    // Upper bound of the range's length: doubled until it leaves the keys that share more than the other neighbour.
    let outside = before.min(after);
    let mut bound = 2;
    while prefix(i + bound * direction) > outside {
        bound *= 2;
    }

    // The other end, by binary search.
    let mut length = 0;
    let mut step = bound / 2;
    while step > 0 {
        if prefix(i + (length + step) * direction) > outside {
            length += step;
        }
        step /= 2;
    }

    // The split, by binary search: the last key, seen from `i`, that shares more than the whole range does.
    let shared = prefix(i + length * direction);
    let mut position = 0;
    let mut step = length;
    while step > 1 {
        step = (step + 1) / 2;
        if position + step < length && prefix(i + (position + step) * direction) > shared {
            position += step;
        }
    }
    // A range that grows downwards finds the first key of the right child.
    (i + position * direction + direction.min(0)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The slow plain reference: splits a run of keys where its highest differing bit changes.
    fn reference(keys: &[u64], node: usize, first: usize, last: usize, splits: &mut [u32]) {
        if first == last {
            return;
        }
        let bit = 63 - (keys[first] ^ keys[last]).leading_zeros();
        let split = (first..last).rfind(|&i| keys[i] >> bit & 1 == 0).expect("the first key has a zero there");
        splits[node] = split as u32;
        reference(keys, split, first, split, splits);
        reference(keys, split + 1, split + 1, last, splits);
    }

    fn expect_reference(mut keys: Vec<u64>) {
        keys.sort_unstable();
        keys.dedup();
        let mut expected = vec![u32::MAX; keys.len().saturating_sub(1)];
        if let Some(last) = keys.len().checked_sub(1) {
            reference(&keys, 0, 0, last, &mut expected);
        }
        assert_eq!(splits(&keys), expected);
    }

    #[test]
    fn small_trees_agree_with_the_reference() {
        expect_reference(vec![]);
        expect_reference(vec![5]);
        expect_reference(vec![0, u64::MAX]);
        // Karras 2012, Fig. 3.
        expect_reference(vec![0b00001, 0b00010, 0b00100, 0b00101, 0b10011, 0b11000, 0b11001, 0b11110]);
        // The deepest tree that 64 bits allow.
        expect_reference((0..64).map(|bit| 1 << bit).chain([0]).collect());
    }

    proptest! {
        #![proptest_config(super::super::seeded())]

        #[test]
        fn agrees_with_the_reference(
            keys in prop::collection::vec(prop_oneof![any::<u64>(), 0..64u64, (0..64u32).prop_map(|b| 1 << b)], 0..300),
        ) {
            expect_reference(keys);
        }
    }
}
