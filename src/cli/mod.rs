//! The command line: one file a verb.

mod backdrop;
mod bake;
mod bench;
mod build;
mod compare;
mod demo;
mod evaluate;
mod expand;
mod info;
mod lamp_flags;
mod output;
mod probe_flags;
mod progress;
mod project;
mod render;
mod scene_flags;
mod stage;
mod transfer;
mod values;
mod view;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::{Error, Result};

/// Lights virtual objects with scanned places.
#[derive(Debug, Parser)]
#[command(name = "relume", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Build a room and an object in code, light the object with every technique, and show the pictures
    Demo(demo::Args),
    /// Make a cloud of a room from a panorama
    Bake(bake::Args),
    /// Build the hierarchy of a cloud and save it
    Build(build::Args),
    /// Compute what distant light does at the vertices of an object, shadows included, and save it
    Transfer(transfer::Args),
    /// Expand the dynamic range of a cloud from an HDR photo
    Expand(Box<expand::Args>),
    /// Light an object inside a cloud, or by light probes; or a cloud by lamps
    Render(Box<render::Args>),
    /// Project a light probe to spherical harmonics
    Project(project::Args),
    /// Open the viewer
    View(Box<view::Args>),
    /// Compare an image with a reference
    Compare(compare::Args),
    /// Hold a step against the truth
    #[command(subcommand)]
    Evaluate(evaluate::Verb),
    /// Measure
    #[command(subcommand)]
    Bench(bench::Verb),
    /// List devices, what each supports, and which one relume would use
    Info(info::Args),
}

/// Runs the command line `arguments` (the program's name first).
///
/// # Errors
/// Everything that goes wrong, as one line; help and version are printed and are no errors.
pub fn run(arguments: impl IntoIterator<Item = std::ffi::OsString>) -> Result<()> {
    let arguments = scene_flags::expanded(arguments.into_iter().collect())?;
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) if !error.use_stderr() => {
            // Help or version. A closed pipe is no reason to fail.
            let _ = error.print();
            return Ok(());
        }
        Err(error) => return Err(Error::Argument(one_line(&error))),
    };
    match cli.verb {
        Verb::Demo(args) => demo::run(&args),
        Verb::Bake(args) => bake::run(&args),
        Verb::Build(args) => build::run(&args),
        Verb::Transfer(args) => transfer::run(&args),
        Verb::Expand(args) => expand::run(&args),
        Verb::Render(args) => render::run(&args),
        Verb::Project(args) => project::run(&args),
        Verb::View(args) => view::run(&args),
        Verb::Compare(args) => compare::run(&args),
        Verb::Evaluate(verb) => evaluate::run(&verb),
        Verb::Bench(verb) => bench::run(&verb),
        Verb::Info(args) => info::run(&args),
    }
}

/// Clap's message without the usage and hints that follow it.
fn one_line(error: &clap::Error) -> String {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "a command is missing; --help lists what there is".into();
    }
    let text = error.to_string();
    let text = text.split("\n\nUsage:").next().unwrap_or(&text);
    let text = text.split("\n\nFor more information").next().unwrap_or(text);
    text.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ")
}
