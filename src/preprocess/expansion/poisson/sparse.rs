//! Sparse matrices by rows, and vectors of several channels, worked on in parallel with the same result to the byte
//! whatever the number of threads.

use rayon::prelude::*;

/// A vector with `C` right-hand sides side by side: one walk over a matrix serves all.
pub(super) type Channels<const C: usize> = Vec<[f64; C]>;

/// Rows that one thread takes at a time. Sums over a vector are sums of sums over such chunks, in order.
const CHUNK: usize = 2048;

/// Rows of (column, value).
#[derive(Default)]
pub(super) struct Sparse {
    /// Where each row begins in `columns`, and where the last one ends.
    pub(super) starts: Vec<usize>,
    pub(super) columns: Vec<u32>,
    /// One value a column; empty when all are -1, as in a graph's Laplacian.
    pub(super) values: Vec<f64>,
}

impl Sparse {
    pub(super) fn rows(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    pub(super) fn columns_of(&self, row: usize) -> &[u32] {
        &self.columns[self.starts[row]..self.starts[row + 1]]
    }

    pub(super) fn entries(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[row]..self.starts[row + 1];
        range.map(|at| (self.columns[at] as usize, self.values.get(at).copied().unwrap_or(-1.0)))
    }

    /// The product of one row with `x`.
    pub(super) fn times<const C: usize>(&self, row: usize, x: &[[f64; C]]) -> [f64; C] {
        let mut sum = [0.0; C];
        if self.values.is_empty() {
            for &column in self.columns_of(row) {
                let value = &x[column as usize];
                (0..C).for_each(|c| sum[c] -= value[c]);
            }
        } else {
            for at in self.starts[row]..self.starts[row + 1] {
                let (factor, value) = (self.values[at], &x[self.columns[at] as usize]);
                (0..C).for_each(|c| sum[c] += factor * value[c]);
            }
        }
        sum
    }

    /// The matrix whose rows `fill` adds up, with columns in ascending order.
    pub(super) fn from_rows(rows: usize, fill: impl Fn(usize, &mut RowSum) + Sync) -> Self {
        let chunks: Vec<Self> = (0..rows.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut part = Self { starts: vec![0], ..Self::default() };
                let mut sum = RowSum::default();
                for row in chunk * CHUNK..rows.min((chunk + 1) * CHUNK) {
                    fill(row, &mut sum);
                    sum.0.sort_unstable_by_key(|&(column, _)| column);
                    part.columns.extend(sum.0.iter().map(|&(column, _)| column));
                    part.values.extend(sum.0.drain(..).map(|(_, value)| value));
                    part.starts.push(part.columns.len());
                }
                part
            })
            .collect();
        let entries = chunks.iter().map(|part| part.columns.len()).sum();
        let mut whole = Self {
            starts: Vec::with_capacity(rows + 1),
            columns: Vec::with_capacity(entries),
            values: Vec::with_capacity(entries),
        };
        whole.starts.push(0);
        for part in chunks {
            let before = whole.columns.len();
            whole.starts.extend(part.starts[1..].iter().map(|end| before + end));
            whole.columns.extend(part.columns);
            whole.values.extend(part.values);
        }
        whole
    }

    /// The transposed matrix, of which `columns` is the number of rows.
    pub(super) fn transposed(&self, columns: usize) -> Self {
        let mut starts = vec![0; columns + 1];
        for &column in &self.columns {
            starts[column as usize + 1] += 1;
        }
        (0..columns).for_each(|row| starts[row + 1] += starts[row]);
        let mut next = starts.clone();
        let mut turned = Self { starts, columns: vec![0; self.columns.len()], values: vec![0.0; self.columns.len()] };
        for row in 0..self.rows() {
            for (column, value) in self.entries(row) {
                turned.columns[next[column]] = row as u32;
                turned.values[next[column]] = value;
                next[column] += 1;
            }
        }
        turned
    }
}

/// One row of a matrix while it is added up. Rows are short: a search through it is faster than a table.
#[derive(Default)]
pub(super) struct RowSum(Vec<(u32, f64)>);

impl RowSum {
    pub(super) fn add(&mut self, column: usize, value: f64) {
        match self.0.iter_mut().find(|(known, _)| *known as usize == column) {
            Some((_, sum)) => *sum += value,
            None => self.0.push((column as u32, value)),
        }
    }
}

/// Replaces each element of `out` by `f` of its index and itself.
pub(super) fn update<T: Copy + Send>(out: &mut [T], f: impl Fn(usize, T) -> T + Sync) {
    let work = |(chunk, part): (usize, &mut [T])| {
        for (at, element) in part.iter_mut().enumerate() {
            *element = f(chunk * CHUNK + at, *element);
        }
    };
    if out.len() > CHUNK {
        out.par_chunks_mut(CHUNK).enumerate().for_each(work);
    } else {
        work((0, out));
    }
}

/// a . b for each channel.
pub(super) fn dot<const C: usize>(a: &[[f64; C]], b: &[[f64; C]]) -> [f64; C] {
    let parts: Channels<C> = (a.par_chunks(CHUNK), b.par_chunks(CHUNK))
        .into_par_iter()
        .map(|(a, b)| a.iter().zip(b).fold([0.0; C], |sum, (a, b)| std::array::from_fn(|c| sum[c] + a[c] * b[c])))
        .collect();
    parts.iter().fold([0.0; C], |sum, part| std::array::from_fn(|c| sum[c] + part[c]))
}
