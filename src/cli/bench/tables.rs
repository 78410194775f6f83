//! Cells as text, laid out as the paper's Table 3: a column for each room, view and micro-buffer, a block for each
//! technique, a row for each viewport.

use std::fmt::Write;

use super::pbgi::{Cell, Measured};
use crate::frames::Technique;

const FIRST: usize = 14;
const COLUMN: usize = 9;

/// A column: room, view, micro-buffer.
type Column = (&'static str, &'static str, u32);

/// All tables of a run.
pub(super) fn all(cells: &[Cell]) -> String {
    let everyone = &Technique::ALL[..];
    let others = &[Technique::Mipmapped, Technique::Hybrid, Technique::Shared][..];
    let mib = |bytes: u64| format!("{:.1}", bytes as f64 / f64::from(1 << 20));
    let ratio = |m: &Measured| m.of_classic.map_or("-".into(), |ratio| format!("{ratio:.2}"));
    let mut text = [
        table(cells, "Time, ms", everyone, |m| number(m.wall_ms)),
        table(cells, "Time over classic's in this run", others, ratio),
        table(cells, "Nodes (classic) or pairs visited per covered pixel", everyone, |m| number(m.visited_per_pixel)),
        table(cells, "Nodes rasterised per covered pixel", everyone, |m| number(m.rasterised_per_pixel)),
        table(cells, "Transform feedback, peak MiB", others, |m| mib(m.peak_feedback_bytes)),
        table(cells, "Micro-buffers, MiB", everyone, |m| mib(m.microbuffer_bytes)),
        table(cells, "Device memory, peak MiB", everyone, |m| mib(m.device_bytes_peak)),
        table(cells, "Batches split and run again", everyone, |m| m.splits.to_string()),
    ]
    .concat();
    text += &shares(cells);
    text += &reasons(cells);
    text
}

fn number(value: f64) -> String {
    if value < 100.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// The different values of something, in order of appearance.
fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut list = Vec::new();
    for value in values {
        if !list.contains(&value) {
            list.push(value);
        }
    }
    list
}

fn table(cells: &[Cell], title: &str, techniques: &[Technique], value: impl Fn(&Measured) -> String) -> String {
    let columns: Vec<Column> = distinct(cells.iter().map(|c| (c.room, c.view, c.microbuffer)));
    let viewports = distinct(cells.iter().map(|c| c.viewport));
    let present = |technique: &&Technique| cells.iter().any(|c| c.technique == **technique);
    let techniques: Vec<&Technique> = techniques.iter().filter(present).collect();
    if techniques.is_empty() {
        return String::new();
    }
    let mut text = format!("\n{title}\n");
    text += &head(&columns);
    for technique in techniques {
        text += &format!("{technique}\n");
        for &viewport in &viewports {
            let mut row = format!("  {:<width$}", format!("{viewport}x{viewport}"), width = FIRST - 2);
            for &(room, view, microbuffer) in &columns {
                let same = |c: &&Cell| {
                    (c.room, c.view, c.microbuffer) == (room, view, microbuffer)
                        && (c.viewport, c.technique) == (viewport, *technique)
                };
                let shown = match cells.iter().find(same) {
                    None => "-".into(),
                    Some(cell) => cell.measured.as_ref().map_or("x".into(), &value),
                };
                row += &format!("{shown:>COLUMN$}");
            }
            text += row.trim_end();
            text.push('\n');
        }
    }
    text
}

/// Three lines above the columns; a room and a view are named once.
fn head(columns: &[Column]) -> String {
    let line = |label: &dyn Fn(usize) -> String| {
        let labels: String = (0..columns.len()).map(|n| format!("{:>COLUMN$}", label(n))).collect();
        format!("{:FIRST$}{}\n", "", labels.trim_end())
    };
    let first = |n: usize, same: &dyn Fn(&Column, &Column) -> bool| n == 0 || !same(&columns[n], &columns[n - 1]);
    let room = |n: usize| if first(n, &|a, b| a.0 == b.0) { columns[n].0.to_owned() } else { String::new() };
    let view = |n: usize| {
        if first(n, &|a, b| (a.0, a.1) == (b.0, b.1)) { columns[n].1.to_owned() } else { String::new() }
    };
    let size = |n: usize| format!("{0}x{0}", columns[n].2);
    [line(&room), line(&view), line(&size)].concat()
}

/// Each pass's share of the wall time, at 512x512 with 24x24 micro-buffers or, in smaller runs, what comes nearest.
fn shares(cells: &[Cell]) -> String {
    let nearest =
        |values: Vec<u32>, wanted: u32| values.into_iter().min_by_key(|v| v.abs_diff(wanted)).unwrap_or(wanted);
    let viewport = nearest(cells.iter().map(|c| c.viewport).collect(), 512);
    let microbuffer = nearest(cells.iter().map(|c| c.microbuffer).collect(), 24);
    let mut text = format!(
        "\nWhere the time goes at {viewport}x{viewport}, {microbuffer}x{microbuffer}: shares of wall time between timestamps\n"
    );
    for cell in cells.iter().filter(|c| (c.viewport, c.microbuffer) == (viewport, microbuffer)) {
        let Some(measured) = &cell.measured else { continue };
        let share = |ms: f64| 100.0 * ms / measured.wall_ms.max(1e-9);
        let mut passes: Vec<(&str, f64)> = measured.passes.iter().map(|(name, p)| (*name, share(p.gpu_ms))).collect();
        let rest = 100.0 - passes.iter().map(|p| p.1).sum::<f64>();
        passes.push(("between passes", rest.max(0.0)));
        passes.sort_by(|a, b| b.1.total_cmp(&a.1));
        let large = passes.iter().filter(|p| p.1 >= 0.5);
        let list: Vec<String> = large.map(|(name, share)| format!("{name} {share:.0} %")).collect();
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "  {:<9} {:<7} {:<10} {:>8} ms: {}",
            cell.room,
            cell.view,
            cell.technique.name(),
            number(measured.wall_ms),
            list.join(", ")
        );
    }
    text
}

/// Why cells have an x.
fn reasons(cells: &[Cell]) -> String {
    let failed: Vec<&Cell> = cells.iter().filter(|c| c.failed.is_some()).collect();
    let mut text = String::new();
    for reason in distinct(failed.iter().filter_map(|c| c.failed.as_deref())) {
        let count = failed.iter().filter(|c| c.failed.as_deref() == Some(reason)).count();
        text += &format!("x ({count} cells): {reason}\n");
    }
    text
}
