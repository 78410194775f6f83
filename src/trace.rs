//! What happened when: spans of the CPU and passes of the GPU on one time line, as a Chrome trace, which Perfetto and
//! chrome://tracing open.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Instant;

use serde_json::{Map, Value, json};

use crate::formats::whole;
use crate::{Error, Result};

/// Collects spans; clones collect into the same place. The default one collects nothing, and a span costs a comparison
/// then.
#[derive(Clone, Default)]
pub struct Trace(Option<Arc<Collection>>);

struct Collection {
    /// Zero of the time line.
    start: Instant,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// In the order in which they began, those of one thread; so outer spans come before inner ones.
    events: Vec<Event>,
    /// Events that [`Trace::clear`] took away.
    cleared: usize,
    threads: Vec<(ThreadId, String)>,
    device: Option<String>,
    notes: Map<String, Value>,
}

struct Event {
    lane: Lane,
    name: &'static str,
    /// Nanoseconds since the start.
    begin: u64,
    /// `None` while the span is open.
    end: Option<u64>,
    counts: Vec<(&'static str, u64)>,
}

/// Where an event is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Lane {
    /// A thread, by its place in the list of threads.
    Cpu(usize),
    /// The queue, in the submission of that number.
    Gpu(u64),
}

/// Processes of the trace.
const CPU: u32 = 1;
const GPU: u32 = 2;

/// An open span of the CPU, which ends when this is dropped.
#[must_use = "a span that is dropped at once has no length"]
pub struct Span(Option<(Trace, usize)>);

impl Trace {
    /// A trace that collects, from now on.
    pub fn new() -> Self {
        Self(Some(Arc::new(Collection { start: Instant::now(), state: Mutex::default() })))
    }

    /// Whether it collects.
    pub fn is_on(&self) -> bool {
        self.0.is_some()
    }

    /// Opens a span on this thread. Spans of a thread must nest, as values that are dropped in turn do.
    pub fn span(&self, name: &'static str) -> Span {
        Span(self.state().map(|mut state| {
            let lane = Lane::Cpu(state.thread());
            state.events.push(Event { lane, name, begin: self.now(), end: None, counts: Vec::new() });
            (self.clone(), state.cleared + state.events.len() - 1)
        }))
    }

    /// Forgets what was collected so far. A viewer calls it when a frame begins, so that the trace holds the last frame
    /// whenever it is written.
    pub fn clear(&self) {
        if let Some(mut state) = self.state() {
            state.cleared += state.events.len();
            state.events.clear();
        }
    }

    /// Nanoseconds since the start; 0 when nothing is collected.
    pub(crate) fn now(&self) -> u64 {
        self.0.as_ref().map_or(0, |collection| collection.start.elapsed().as_nanos() as u64)
    }

    /// Names the process of the GPU.
    pub(crate) fn set_device(&self, name: &str) {
        if let Some(mut state) = self.state() {
            state.device = Some(name.into());
        }
    }

    /// Adds a line to the file's metadata.
    pub fn note(&self, key: &str, value: impl Into<Value>) {
        if let Some(mut state) = self.state() {
            state.notes.insert(key.into(), value.into());
        }
    }

    /// Adds a pass of a submission, in nanoseconds since the start.
    pub(crate) fn pass(
        &self,
        submission: u64,
        name: &'static str,
        time: std::ops::Range<u64>,
        counts: &[(&'static str, u64)],
    ) {
        if let Some(mut state) = self.state() {
            let (lane, counts) = (Lane::Gpu(submission), counts.to_vec());
            state.events.push(Event { lane, name, begin: time.start, end: Some(time.end), counts });
        }
    }

    /// Adds counts that are known only after a submission to the last run of a pass in it. Where the pass ran more than
    /// once there, they are those of all its runs, whose number is added as `counted_runs`.
    pub(crate) fn count(&self, pass: &'static str, counts: &[(&'static str, u64)]) {
        let Some(mut state) = self.state() else { return };
        let is_pass = |event: &&mut Event| matches!(event.lane, Lane::Gpu(_)) && event.name == pass;
        let mut runs = state.events.iter_mut().rev().filter(is_pass);
        let Some(last) = runs.next() else { return };
        let others = runs.take_while(|event| event.lane == last.lane).count() as u64;
        last.counts.extend_from_slice(counts);
        if others > 0 {
            last.counts.push(("counted_runs", others + 1));
        }
    }

    /// Writes what was collected; open spans end now. Nothing is written when nothing is collected.
    ///
    /// # Errors
    /// [`Error::File`] when the file cannot be written; there is none then.
    pub fn write(&self, path: &Path) -> Result<()> {
        let now = self.now();
        let Some(state) = self.state() else { return Ok(()) };
        let (events, notes) = (state.to_json(now), state.notes.clone());
        drop(state);
        let file = json!({ "traceEvents": events, "displayTimeUnit": "ms", "otherData": notes });
        whole::write(path, |out| {
            serde_json::to_writer(out, &file).map_err(|e| Error::file(path, format!("cannot be written: {e}")))
        })
    }

    fn state(&self) -> Option<MutexGuard<'_, State>> {
        self.0.as_ref().map(|collection| collection.state.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl State {
    /// This thread's place in the list.
    fn thread(&mut self) -> usize {
        let id = thread::current().id();
        self.threads.iter().position(|(known, _)| *known == id).unwrap_or_else(|| {
            let name = thread::current().name().map_or_else(|| format!("{id:?}"), str::to_owned);
            self.threads.push((id, name));
            self.threads.len() - 1
        })
    }

    /// The trace event format's list.
    fn to_json(&self, now: u64) -> Vec<Value> {
        let name = |kind: &str, process: u32, thread: usize, name: &str| json!({ "ph": "M", "name": kind, "pid": process, "tid": thread, "args": { "name": name } });
        let mut list = vec![name("process_name", CPU, 0, "CPU")];
        list.extend(self.threads.iter().enumerate().map(|(i, (_, own))| name("thread_name", CPU, i + 1, own)));
        if let Some(device) = &self.device {
            list.push(name("process_name", GPU, 0, &format!("GPU {device}")));
            list.push(name("thread_name", GPU, 1, "queue"));
        }
        // Microseconds, to the nanosecond.
        let micro = |nanoseconds: u64| nanoseconds as f64 / 1e3;
        list.extend(self.events.iter().map(|event| {
            let mut counts: Map<String, Value> = event.counts.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect();
            let (process, thread, category) = match event.lane {
                Lane::Cpu(thread) => (CPU, thread + 1, "cpu"),
                Lane::Gpu(submission) => {
                    counts.insert("submission".into(), submission.into());
                    (GPU, 1, "gpu")
                }
            };
            json!({
                "ph": "X", "name": event.name, "cat": category, "pid": process, "tid": thread,
                "ts": micro(event.begin), "dur": micro(event.end.unwrap_or(now).saturating_sub(event.begin)), "args": counts,
            })
        }));
        list
    }
}

impl Span {
    /// Adds a number to the span, such as how much was done in it.
    pub fn count(&self, what: &'static str, amount: u64) {
        self.with_event(|event, _| event.counts.push((what, amount)));
    }

    /// Calls `change` with the span's event and the time, unless the trace is off or was cleared.
    fn with_event(&self, change: impl FnOnce(&mut Event, u64)) {
        let Some((trace, at)) = &self.0 else { return };
        let Some(mut state) = trace.state() else { return };
        let index = at.checked_sub(state.cleared);
        if let Some(event) = index.and_then(|index| state.events.get_mut(index)) {
            change(event, trace.now());
        }
    }
}

impl Drop for Span {
    fn drop(&mut self) {
        self.with_event(|event, now| event.end = Some(now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn events(trace: &Trace) -> Vec<Value> {
        let state = trace.state().expect("a trace that is on");
        state.to_json(trace.now()).into_iter().filter(|event| event["ph"] == "X").collect()
    }

    #[test]
    fn counts_go_to_the_last_run_of_the_last_submission() {
        let trace = Trace::new();
        for (submission, name) in [(1, "a"), (2, "a"), (2, "b"), (2, "a")] {
            trace.pass(submission, name, 0..1, &[]);
        }
        trace.count("a", &[("pairs", 5)]);
        trace.count("b", &[("pairs", 7)]);
        trace.count("c", &[("pairs", 9)]);
        let list = events(&trace);
        assert_eq!(list[3]["args"], json!({ "pairs": 5, "counted_runs": 2, "submission": 2 }));
        assert_eq!(list[2]["args"], json!({ "pairs": 7, "submission": 2 }));
        assert_eq!(list[0]["args"], json!({ "submission": 1 }));
    }

    #[test]
    fn spans_outlive_a_clear_and_a_trace_that_is_off() {
        let trace = Trace::new();
        let outer = trace.span("outer");
        trace.clear();
        let inner = trace.span("inner");
        drop(outer);
        inner.count("things", 3);
        drop(inner);
        let list = events(&trace);
        assert_eq!(list.len(), 1);
        assert_eq!((&list[0]["name"], &list[0]["args"]["things"]), (&json!("inner"), &json!(3)));
        let off = Trace::default();
        off.span("nothing").count("things", 1);
        assert!(!off.is_on() && off.now() == 0);
    }
}
