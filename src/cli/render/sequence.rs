//! Frames of a sequence: their names, and which of them are there already.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Names of the frames of a sequence: a path with one run of `#` in its file name, or the one name of a single frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FrameNames {
    pattern: PathBuf,
    /// Before the run, its length, and behind it.
    parts: Option<(String, usize, String)>,
}

impl FrameNames {
    /// # Errors
    /// [`Error::File`] for two runs of `#`.
    pub(super) fn new(pattern: &Path) -> Result<Self> {
        let name = pattern.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let Some(start) = name.find('#') else { return Ok(Self { pattern: pattern.to_owned(), parts: None }) };
        let digits = name[start..].len() - name[start..].trim_start_matches('#').len();
        let (before, behind) = (name[..start].to_owned(), name[start + digits..].to_owned());
        if behind.contains('#') {
            return Err(Error::file(pattern, "has two runs of # in its name; one stands for the frame's number"));
        }
        Ok(Self { pattern: pattern.to_owned(), parts: Some((before, digits, behind)) })
    }

    /// Whether there is a name for more than one frame.
    pub(super) fn many(&self) -> bool {
        self.parts.is_some()
    }

    /// The file of a frame.
    pub(super) fn path(&self, number: u64) -> PathBuf {
        match &self.parts {
            None => self.pattern.clone(),
            Some((before, digits, behind)) => self.pattern.with_file_name(format!("{before}{number:0digits$}{behind}")),
        }
    }

    /// Removes what a run that was killed has left of the frame that it was at.
    fn clear_parts(&self) {
        let Some((before, _, _)) = &self.parts else { return };
        let folder = self.pattern.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&format!(".{before}")) && name.ends_with(".part") {
                // It is in nobody's way.
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// The file that says which frames are there, while not all are.
    fn journal(&self) -> PathBuf {
        let name = self.pattern.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        self.pattern.with_file_name(format!(".{name}.frames"))
    }
}

/// Which frames of a sequence are finished, in a hidden file beside them: a run that was ended early is gone on with by
/// the same command, and by no other, whose frames would not match. It is there only as long as frames are missing.
pub(super) struct Journal {
    path: PathBuf,
    done: Vec<u64>,
}

impl Journal {
    /// Reads what a run of the same `job`, a single line, has left, or starts anew.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be written.
    pub(super) fn open(names: &FrameNames, job: &str) -> Result<Self> {
        let path = names.journal();
        let text = fs::read_to_string(&path).unwrap_or_default();
        let mut lines = text.split_inclusive('\n');
        let same = lines.next().is_some_and(|line| line.strip_suffix('\n') == Some(job));
        if !same {
            fs::write(&path, format!("{job}\n")).map_err(|e| Error::file(&path, format!("cannot be written: {e}")))?;
            return Ok(Self { path, done: Vec::new() });
        }
        names.clear_parts();
        // A last line without its end may be cut short.
        let whole = lines.filter_map(|line| line.strip_suffix('\n')?.parse().ok());
        let done = whole.filter(|number| names.path(*number).is_file()).collect();
        Ok(Self { path, done })
    }

    /// Whether a frame is finished.
    pub(super) fn has(&self, number: u64) -> bool {
        self.done.contains(&number)
    }

    /// Adds a frame, whose file is complete.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be written.
    pub(super) fn add(&mut self, number: u64) -> Result<()> {
        let written = OpenOptions::new().append(true).open(&self.path).and_then(|mut file| writeln!(file, "{number}"));
        written.map_err(|e| Error::file(&self.path, format!("cannot be written: {e}")))?;
        self.done.push(number);
        Ok(())
    }

    /// All frames are there.
    pub(super) fn close(self) {
        // What is left behind would only say that everything is done.
        let _ = fs::remove_file(&self.path);
    }
}

/// `A..B`, both of them included, or a single number.
pub(in crate::cli) fn frames(text: &str) -> Result<RangeInclusive<u64>, String> {
    let wrong = || format!("{text:?} is no range of frames, A..B with A not above B, both included");
    let number = |part: &str| part.trim().parse::<u64>().map_err(|_| wrong());
    let (first, last) = match text.split_once("..") {
        None => (number(text)?, number(text)?),
        Some((first, last)) => (number(first)?, number(last.trim_start_matches('='))?),
    };
    if first > last || last - first >= MOST_FRAMES { Err(wrong()) } else { Ok(first..=last) }
}

/// More frames than anybody waits for.
const MOST_FRAMES: u64 = 1 << 32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_include_both_ends() {
        assert_eq!(frames("3..7"), Ok(3..=7));
        assert_eq!(frames("3..=7"), Ok(3..=7));
        assert_eq!(frames("5"), Ok(5..=5));
        for wrong in ["", "7..3", "a..b", "-1..4", "1..", "0..99999999999"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn names_have_the_digits_of_their_pattern() {
        let names = FrameNames::new(Path::new("out/f.###.exr")).expect("a pattern");
        assert_eq!(names.path(7), Path::new("out/f.007.exr"));
        assert_eq!(names.path(12_345), Path::new("out/f.12345.exr"));
        assert!(!FrameNames::new(Path::new("f.exr")).expect("a name").many());
        assert!(FrameNames::new(Path::new("f#.#.exr")).is_err());
    }

    #[test]
    fn a_journal_knows_what_the_same_job_has_finished() {
        let folder = tempfile::tempdir().expect("a folder");
        let names = FrameNames::new(&folder.path().join("f.##.exr")).expect("a pattern");
        let mut journal = Journal::open(&names, "job one").expect("a journal");
        for number in [0, 1, 2] {
            fs::write(names.path(number), "x").expect("a frame");
            journal.add(number).expect("added");
        }
        drop(journal);
        fs::remove_file(names.path(1)).expect("a frame goes");
        // A line that was cut short is no frame.
        let path = names.journal();
        let text = fs::read_to_string(&path).expect("a journal");
        fs::write(&path, text.trim_end()).expect("cut");
        let again = Journal::open(&names, "job one").expect("a journal");
        assert_eq!([0, 1, 2].map(|n| again.has(n)), [true, false, false]);
        let other = Journal::open(&names, "job two").expect("a journal");
        assert!(!other.has(0));
        other.close();
        assert!(!path.exists());
    }
}
