//! Morton codes: G. M. Morton, "A Computer Oriented Geodetic Data Base", 1966; as keys of a hierarchy: T. Karras,
//! "Maximizing Parallelism in the Construction of BVHs, Octrees, and k-d Trees", 2012, section 2.

use glam::{DVec3, Vec3};

/// Bits an axis; three of them fill 63 of the 64 bits of a code.
pub(super) const BITS: u32 = 21;

/// Cells an axis.
const CELLS: u32 = 1 << BITS;

/// A cubic lattice over the bounding box of a cloud, 2^21 cells along its longest side.
#[derive(Clone, Copy, Debug)]
pub(in crate::preprocess) struct Lattice {
    corner: DVec3,
    cells_per_metre: f64,
}

impl Lattice {
    /// The lattice over the box from `low` to `high`. A box without extent has one cell.
    pub(in crate::preprocess) fn new(low: Vec3, high: Vec3) -> Self {
        // In f64, because the difference of two f32 may overflow or round away a whole cell.
        let extent = (high.as_dvec3() - low.as_dvec3()).max_element();
        let cells_per_metre = if extent > 0.0 { f64::from(CELLS) / extent } else { 0.0 };
        Self { corner: low.as_dvec3(), cells_per_metre }
    }

    /// The Morton code of the cell that holds `position`.
    pub(in crate::preprocess) fn code(&self, position: Vec3) -> u64 {
        let cell = (position.as_dvec3() - self.corner) * self.cells_per_metre;
        // The cast to an integer saturates, the far side of the box belongs to the last cell.
        let [x, y, z] = cell.to_array().map(|c| spread((c as u32).min(CELLS - 1)));
        // ... z1 y1 x1 z0 y0 x0
        x | y << 1 | z << 2
    }
}

/// Puts two empty bits behind each of the low 21 bits.
fn spread(cell: u32) -> u64 {
    let mut bits = u64::from(cell) & 0x1f_ffff; // .......................................... 20 ... 1 0, in one run
    bits = (bits | bits << 32) & 0x001f_0000_0000_ffff; // 20..16 | 15..0
    bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff; // 20..16 | 15..8 | 7..0
    bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f; // runs of 4
    bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3; // runs of 2
    (bits | bits << 2) & 0x1249_2492_4924_9249 // single bits, 3 apart
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn spreading_puts_every_bit_at_three_times_its_place() {
        for bit in 0..BITS {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
        }
        assert_eq!(spread(CELLS - 1).count_ones(), BITS);
        assert_eq!(spread(CELLS), 0, "bits beyond the lattice are dropped");
    }

    #[test]
    fn corners_of_the_box_get_the_first_and_the_last_code() {
        let (low, high) = (Vec3::new(-3.0, 1.0, 1e9), Vec3::new(5.0, 9.0, 1e9 + 8.0));
        let lattice = Lattice::new(low, high);
        assert_eq!(lattice.code(low), 0);
        assert_eq!(lattice.code(Vec3::new(5.0, 9.0, 1e9)), spread(CELLS - 1) | spread(CELLS - 1) << 1);
    }

    #[test]
    fn a_box_without_extent_has_one_cell() {
        let corner = Vec3::splat(7.0);
        assert_eq!(Lattice::new(corner, corner).code(corner), 0);
    }

    proptest! {
        #![proptest_config(super::super::seeded())]

        #[test]
        fn codes_interleave_the_bits_of_the_cell(x in 0..CELLS, y in 0..CELLS, z in 0..CELLS) {
            // A box of one metre a cell, and points in the middle of theirs.
            let lattice = Lattice::new(Vec3::ZERO, Vec3::splat(CELLS as f32));
            let position = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
            let expected = (0..BITS).fold(0u64, |code, bit| {
                let [x, y, z] = [x, y, z].map(|cell| u64::from(cell >> bit & 1));
                code | (x | y << 1 | z << 2) << (3 * bit)
            });
            prop_assert_eq!(lattice.code(position), expected);
        }
    }
}
