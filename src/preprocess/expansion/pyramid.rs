//! Image pyramids that patches are read from.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};

/// Texels around a level that repeat its edge: as far as a patch at the largest scale reaches from a centre inside.
pub const MARGIN: u32 = 14;

/// One level.
#[derive(Clone, Debug)]
pub struct Level {
    /// Width in texels without the margin.
    pub width: u32,
    /// Height in texels without the margin.
    pub height: u32,
    /// Colours, and validity from 0 to 1 in w, row by row with the margin.
    texels: Vec<Vec4>,
}

impl Level {
    fn new(width: u32, height: u32, texel: impl Fn(u32, u32) -> Vec4) -> Self {
        let inside = |at: u32, side: u32| at.saturating_sub(MARGIN).min(side - 1);
        let texels = (0..height + 2 * MARGIN)
            .flat_map(|y| (0..width + 2 * MARGIN).map(move |x| (x, y)))
            .map(|(x, y)| texel(inside(x, width), inside(y, height)))
            .collect();
        Self { width, height, texels }
    }

    fn stride(&self) -> usize {
        (self.width + 2 * MARGIN) as usize
    }

    /// The texel at (x, y), which may lie in the margin.
    pub fn texel(&self, x: i32, y: i32) -> Vec4 {
        let margin = MARGIN as i32;
        self.texels[(y + margin) as usize * self.stride() + (x + margin) as usize]
    }

    /// Texels from (x, y) to the right, both possibly in the margin.
    pub fn row(&self, x: i32, y: i32, count: usize) -> &[Vec4] {
        let margin = MARGIN as i32;
        let start = (y + margin) as usize * self.stride() + (x + margin) as usize;
        &self.texels[start..start + count]
    }

    /// Calls `f` with bilinear samples at `first`, `first + step`, ..., `count` of them, which must not leave the margin
    /// (else they repeat its edge). Texel (0, 0) has its centre at (0, 0).
    #[inline(always)]
    pub fn samples(&self, first: Vec2, step: Vec2, count: usize, mut f: impl FnMut(usize, Vec4)) {
        let stride = self.stride();
        let last = Vec2::new(stride as f32 - 1.001, (self.height + 2 * MARGIN) as f32 - 1.001);
        // Positive, so that truncation is the floor.
        let mut at = first + MARGIN as f32;
        for n in 0..count {
            let inside = at.clamp(Vec2::ZERO, last);
            let (x, y) = (inside.x as u32, inside.y as u32);
            let (fx, fy) = (inside.x - x as f32, inside.y - y as f32);
            let start = y as usize * stride + x as usize;
            debug_assert!(start + stride + 1 < self.texels.len());
            // SAFETY: x and y are at most two less than width and height with the margin, whatever was asked for (a NaN
            // truncates to 0), and `texels` holds all rows.
            let [a, b, c, d] = unsafe {
                let texel = |n: usize| *self.texels.get_unchecked(n);
                [texel(start), texel(start + 1), texel(start + stride), texel(start + stride + 1)]
            };
            let upper = a + (b - a) * fx;
            let lower = c + (d - c) * fx;
            f(n, upper + (lower - upper) * fy);
            at += step;
        }
    }

    /// True where a patch around `centre` has all its texels.
    pub fn holds(&self, centre: Vec2) -> bool {
        let last = Vec2::new(self.width as f32, self.height as f32) - 0.5;
        centre.cmpge(Vec2::splat(-0.5)).all() && centre.cmple(last).all()
    }
}

/// Levels from fine to coarse; each has half the size of the one before, rounded up.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// At least one.
    pub levels: Vec<Level>,
}

impl Pyramid {
    /// Builds `count` levels. `texel` gives the colour and validity, from 0 to 1, of a pixel. Invalid pixels take the
    /// mean colour of what is valid around them.
    pub fn new(width: u32, height: u32, count: usize, texel: impl Fn(u32, u32) -> (Vec3, f32)) -> Self {
        // Colours multiplied by validity, so that means are means of what is valid.
        let weighted = |x, y| {
            let (color, valid) = texel(x, y);
            (color * valid).extend(valid)
        };
        let mut levels = vec![Level::new(width, height, weighted)];
        while levels.len() < count.max(1) {
            levels.push(halved(&levels[levels.len() - 1]));
        }
        // From coarse to fine: what is invalid takes the colour of the level above.
        for index in (0..levels.len()).rev() {
            let coarser = levels.get(index + 1).cloned();
            let level = &levels[index];
            let filled = Level::new(level.width, level.height, |x, y| {
                let texel = level.texel(x as i32, y as i32);
                let above = coarser.as_ref().map_or(Vec3::ZERO, |c| c.texel(x as i32 / 2, y as i32 / 2).xyz());
                (texel.xyz() + above * (1.0 - texel.w)).extend(texel.w)
            });
            levels[index] = filled;
        }
        Self { levels }
    }

    /// The same, where nothing is known beyond the edges: the margins are not valid.
    pub fn bounded(mut self) -> Self {
        for level in &mut self.levels {
            let stride = level.stride();
            let (columns, rows) = (MARGIN as usize..stride - MARGIN as usize, MARGIN..MARGIN + level.height);
            for (n, texel) in level.texels.iter_mut().enumerate() {
                if !columns.contains(&(n % stride)) || !rows.contains(&((n / stride) as u32)) {
                    texel.w = 0.0;
                }
            }
        }
        self
    }
}

/// Means of 2 x 2 texels; a last odd row or column counts twice.
fn halved(level: &Level) -> Level {
    Level::new(level.width.div_ceil(2), level.height.div_ceil(2), |x, y| {
        let (x, y) = (2 * x as i32, 2 * y as i32);
        0.25 * (level.texel(x, y) + level.texel(x + 1, y) + level.texel(x, y + 1) + level.texel(x + 1, y + 1))
    })
}
