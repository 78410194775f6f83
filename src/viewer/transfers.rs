//! What distant light does at the vertices of the object, for technique probes: made once that is in use.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::formats::prt::{self, Source};
use crate::preprocess::transfer::{Transfer, TransferOptions, compute};
use crate::scene::Object;
use crate::{Error, Result};

/// Directions a vertex for pictures of things that move.
const QUICK_DIRECTIONS: u32 = 400;
/// How far a transfer is that is being made is looked at this often.
const LOOK: Duration = Duration::from_millis(50);
/// Shares are told in such steps.
const STEPS: f32 = 100.0;

/// The transfers of one object.
#[derive(Default)]
pub(super) struct Transfers {
    quick: Option<Arc<Transfer>>,
    own: Option<Arc<Transfer>>,
    making: Option<Making>,
}

/// The object's own transfer, on a thread of its own: it may take minutes.
struct Making {
    thread: JoinHandle<Made>,
    /// How far it is, steps of [`STEPS`].
    done: Arc<AtomicU32>,
    told: Option<u32>,
}

/// A transfer, and why it was not saved.
type Made = Result<(Transfer, Option<Error>)>;

/// What there is to tell of a transfer that is being made.
pub(super) enum News {
    /// It is farther: the share of the whole.
    Share(f32),
    /// It is there, and why it was not saved.
    Made(Option<Error>),
    /// There will be none.
    Failed(Error),
}

impl Transfers {
    /// That of the simplified object, made at once where it is not there.
    ///
    /// # Errors
    /// Those of [`compute`].
    pub(super) fn quick(&mut self, simple: &Object) -> Result<Arc<Transfer>> {
        if let Some(quick) = &self.quick {
            return Ok(quick.clone());
        }
        let options = TransferOptions { samples: QUICK_DIRECTIONS, ..TransferOptions::default() };
        let transfer = Arc::new(compute(simple, &options, &|_| {})?);
        self.quick = Some(transfer.clone());
        Ok(transfer)
    }

    /// That of the object itself or of the simplified one, where it is there.
    pub(super) fn of(&self, own: bool) -> Option<&Arc<Transfer>> {
        if own { self.own.as_ref() } else { self.quick.as_ref() }
    }

    /// Begins to read or make that of the object itself, which has its file beside the object's, at `path`.
    ///
    /// # Errors
    /// When the system has no threads left.
    pub(super) fn make(&mut self, path: &Path, object: &Arc<Object>) -> Result<()> {
        if self.own.is_some() || self.making.is_some() {
            return Ok(());
        }
        let no_thread = |e: &dyn std::fmt::Display| Error::Device(format!("no thread could be started: {e}"));
        // Threads of its own: pictures that are made meanwhile would have to wait for those that all share.
        let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let pool = rayon::ThreadPoolBuilder::new().num_threads((most - 1).max(1)).build().map_err(|e| no_thread(&e))?;
        let done = Arc::new(AtomicU32::new(0));
        let (path, object, theirs) = (path.with_extension("prt"), object.clone(), done.clone());
        let thread = std::thread::Builder::new()
            .name("transfer".into())
            .spawn(move || pool.install(|| made(&path, &object, &theirs)))
            .map_err(|e| no_thread(&e))?;
        self.making = Some(Making { thread, done, told: None });
        Ok(())
    }

    /// What is new; none where nothing is, or nothing is being made.
    pub(super) fn news(&mut self) -> Option<News> {
        let making = self.making.as_mut()?;
        if !making.thread.is_finished() {
            let done = making.done.load(Ordering::Relaxed);
            let new = making.told.replace(done) != Some(done);
            return new.then_some(News::Share(done as f32 / STEPS));
        }
        match self.making.take()?.thread.join() {
            Ok(Ok((transfer, unsaved))) => {
                self.own = Some(Arc::new(transfer));
                Some(News::Made(unsaved))
            }
            Ok(Err(error)) => Some(News::Failed(error)),
            // The panic was reported by its own hook.
            Err(_) => Some(News::Failed(Error::Argument("the object's transfer could not be made".into()))),
        }
    }

    /// How long there is nothing to do; none where nothing is being made.
    pub(super) fn wait(&self) -> Option<Duration> {
        self.making.as_ref().map(|_| LOOK)
    }
}

/// Reads or makes the transfer. Where its name belongs to something else, that stays and the transfer is not saved.
fn made(path: &Path, object: &Object, done: &AtomicU32) -> Made {
    let progress = |share: f32| {
        done.fetch_max((share * STEPS) as u32, Ordering::Relaxed);
    };
    let options = TransferOptions::default();
    match prt::load_or_compute(Some(path), object, &options, &progress) {
        Ok((transfer, Source::ComputedUnsaved(error))) => Ok((transfer, Some(error))),
        Ok((transfer, Source::Read | Source::Computed)) => Ok((transfer, None)),
        Err(error @ Error::File { .. }) => Ok((compute(object, &options, &progress)?, Some(error))),
        Err(error) => Err(error),
    }
}
