//! Curves as SVG.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::formats::whole;
use crate::{Error, Result};

const SIZE: (u32, u32) = (900, 560);
/// Ticks are computed in f64: nothing beyond this, or on a logarithmic axis below its inverse, can be drawn.
const LARGEST: f64 = 1e100;
const FONT: &str = "sans-serif";
/// Colours for eight curves that colour-blind people tell apart (Okabe and Ito 2008), then around again.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(150, 140, 40),
];

/// One axis of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub title: String,
    /// True for a logarithmic axis; all values on it must then be above 0.
    pub logarithmic: bool,
}

/// A named curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points in the order in which a line joins them.
    pub points: Vec<(f64, f64)>,
}

/// Several curves over two axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Line above the plot.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The curves; at least one point in all.
    pub series: Vec<Series>,
}

impl Plot {
    /// Writes an SVG of 900x560. [`Error::Argument`] when there is nothing to draw, a value is not finite or beyond
    /// 1e100, or not above 0 on a logarithmic axis; [`Error::File`] when `path` cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let svg = self.svg()?;
        let failed = |e| Error::file(path, format!("cannot be written: {e}"));
        whole::write(path, |file| file.write_all(svg.as_bytes()).map_err(failed))
    }

    fn svg(&self) -> Result<String> {
        let (x, y) = (self.range(&self.x, |point| point.0)?, self.range(&self.y, |point| point.1)?);
        let (linear_x, linear_y): (RangedCoordf64, RangedCoordf64) = (x.clone().into(), y.clone().into());
        match (self.x.logarithmic, self.y.logarithmic) {
            (false, false) => self.draw(linear_x, linear_y),
            (true, false) => self.draw(x.log_scale(), linear_y),
            (false, true) => self.draw(linear_x, y.log_scale()),
            (true, true) => self.draw(x.log_scale(), y.log_scale()),
        }
    }

    /// What `axis` has to hold, with some air.
    fn range(&self, axis: &Axis, value: fn(&(f64, f64)) -> f64) -> Result<Range<f64>> {
        let refuse = |problem: String| Err(Error::Argument(format!("plot \"{}\": {problem}", self.title)));
        let values = || self.series.iter().flat_map(|series| &series.points).map(value);
        let drawable = |v: f64| v.abs() <= LARGEST && (!axis.logarithmic || v >= 1.0 / LARGEST);
        if let Some(bad) = values().find(|&v| !drawable(v)) {
            return refuse(format!("{bad} cannot be drawn on \"{}\"", axis.title));
        }
        let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return refuse("no points".into());
        }
        if axis.logarithmic {
            // ticks start at a power of ten: a range that held none would have none; a little lower for rounding
            return Ok(0.9999 * 10.0_f64.powf(low.log10().floor())..high * 1.25);
        }
        // ticks need steps that still change the numbers that they are added to
        let (length, size) = (high - low, high.abs().max(low.abs()));
        let air = if length > 1e-9 * size.max(1.0 / LARGEST) { 0.04 * length } else { 0.5 * size.max(1e-3) };
        // an axis of magnitudes keeps its zero
        Ok(if low >= 0.0 && low < 0.3 * high { 0.0 } else { low - air }..high + air)
    }

    fn draw<X, Y>(&self, x: X, y: Y) -> Result<String>
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let failed = |e: DrawingAreaErrorKind<std::io::Error>| Error::Argument(format!("plot \"{}\": {e}", self.title));
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
            area.fill(&WHITE).map_err(failed)?;
            let mut chart = ChartBuilder::on(&area)
                .caption(&self.title, (FONT, 22))
                .margin(12)
                .x_label_area_size(48)
                .y_label_area_size(72)
                .build_cartesian_2d(x, y)
                .map_err(failed)?;
            chart
                .configure_mesh()
                .x_desc(&self.x.title)
                .y_desc(&self.y.title)
                .axis_desc_style((FONT, 16))
                .label_style((FONT, 14))
                .light_line_style(WHITE.mix(0.0))
                .bold_line_style(BLACK.mix(0.12))
                .x_label_formatter(&short)
                .y_label_formatter(&short)
                .draw()
                .map_err(failed)?;
            for (series, color) in self.series.iter().zip(COLORS.into_iter().cycle()) {
                chart
                    .draw_series(LineSeries::new(series.points.iter().copied(), color.stroke_width(2)).point_size(3))
                    .map_err(failed)?
                    .label(&series.name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], color.stroke_width(2)));
            }
            let lines: Vec<Vec<(i32, i32)>> = self
                .series
                .iter()
                .map(|series| series.points.iter().map(|point| chart.backend_coord(point)).collect())
                .collect();
            let place = emptiest(&lines, chart.plotting_area().get_pixel_range());
            chart
                .configure_series_labels()
                .position(place)
                .background_style(WHITE.mix(0.85))
                .border_style(BLACK.mix(0.3))
                .label_font((FONT, 15))
                .draw()
                .map_err(failed)?;
            area.present().map_err(failed)?;
        }
        Ok(svg)
    }
}

/// The corner or side of the plot that the fewest lines cross, for the legend.
fn emptiest(lines: &[Vec<(i32, i32)>], (across, down): (Range<i32>, Range<i32>)) -> SeriesLabelPosition {
    const STEPS: i32 = 16;
    let third = |at: i32, range: &Range<i32>| ((at - range.start) * 3 / (range.end - range.start).max(1)).clamp(0, 2);
    let mut crossed = [[0; 3]; 3];
    for (from, to) in lines.iter().flat_map(|line| line.iter().zip(line.iter().skip(1))) {
        for k in 0..=STEPS {
            let between = |a: i32, b: i32| a + (b - a) * k / STEPS;
            let (x, y) = (between(from.0, to.0), between(from.1, to.1));
            crossed[third(y, &down) as usize][third(x, &across) as usize] += 1;
        }
    }
    let places = [
        (SeriesLabelPosition::UpperRight, crossed[0][2]),
        (SeriesLabelPosition::UpperLeft, crossed[0][0]),
        (SeriesLabelPosition::LowerRight, crossed[2][2]),
        (SeriesLabelPosition::LowerLeft, crossed[2][0]),
        (SeriesLabelPosition::MiddleRight, crossed[1][2]),
        (SeriesLabelPosition::MiddleLeft, crossed[1][0]),
    ];
    places.into_iter().min_by_key(|(_, lines)| *lines).map_or(SeriesLabelPosition::UpperRight, |(place, _)| place)
}

/// A tick's number without the noise of binary fractions.
fn short(value: &f64) -> String {
    if *value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.1e}");
    }
    let text = format!("{value:.5}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
