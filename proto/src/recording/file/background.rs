//! A recording written by a separate thread, so that the stream never waits.

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::backlog::{Backlog, GapTotals};
use super::disk::{Disk, DiskError, Sink};
use super::options::Observer;
use super::recorder::Clock;
use super::{FileError, RecorderNotice, RecorderOptions, RecordingOutcome};
use crate::Micros;

/// Time between two flushes to the disk, which bounds the loss at a power cut.
const SYNC_INTERVAL: Micros = Micros::from_secs(1);

/// The stream's side of the recorder. It takes frames and never waits.
pub(super) struct BackgroundRecorder {
    path: PathBuf,
    shared: Arc<Shared>,
    /// The writing thread; `None` after it was joined.
    writer: Option<JoinHandle<Result<u64, FileError>>>,
    /// Whether the observer was told that the disk is too slow.
    told_behind: bool,
}

struct Shared {
    backlog: Mutex<Backlog>,
    changed: Condvar,
    clock: Clock,
    observer: Observer,
}

impl BackgroundRecorder {
    /// Starts the writing thread.
    pub(super) fn start(sink: impl Sink, options: RecorderOptions, clock: Clock) -> Result<Self, FileError> {
        let path = sink.path().to_owned();
        let shared = Arc::new(Shared {
            backlog: Mutex::new(Backlog::new(options.buffer_bytes, options.limits)),
            changed: Condvar::new(),
            clock,
            observer: options.observer,
        });
        let writing = Arc::clone(&shared);
        let writer = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || writing.write(Disk::new(sink, options.limits)))
            .map_err(FileError::Thread)?;
        Ok(Self { path, shared, writer: Some(writer), told_behind: false })
    }

    /// Queues a frame, or counts it as missing.
    pub(super) fn take(&mut self, arrival: Micros, frame: &[u8]) {
        let taken = self.shared.lock().offer(arrival, frame);
        self.shared.changed.notify_one();
        if !taken && !self.told_behind {
            self.told_behind = true;
            (self.shared.observer)(RecorderNotice::Behind);
        }
    }

    /// Returns whether a keyframe is wanted, see [`Backlog::wants_keyframe`].
    pub(super) fn wants_keyframe(&self, now: Micros, due: Option<u64>) -> bool {
        self.shared.lock().wants_keyframe(now, due)
    }

    /// Returns the frames that are missing so far.
    pub(super) fn missing(&self) -> GapTotals {
        self.shared.lock().missing()
    }

    /// Writes all queued frames and ends the recording.
    pub(super) fn finish(mut self) -> Result<RecordingOutcome, FileError> {
        let written = self.end()?;
        let missing = self.shared.lock().missing();
        if missing.gaps > 0 {
            (self.shared.observer)(RecorderNotice::Incomplete(missing));
        }
        Ok(RecordingOutcome { bytes: written?, missing })
    }

    /// Waits until the thread has ended. Returns its result, which is the length of the file.
    fn end(&mut self) -> Result<Result<u64, FileError>, FileError> {
        self.shared.lock().end(self.shared.clock.now());
        self.shared.changed.notify_one();
        let failed = || FileError::ThreadFailed { path: self.path.clone() };
        self.writer.take().and_then(|writer| writer.join().ok()).ok_or_else(failed)
    }
}

impl Drop for BackgroundRecorder {
    fn drop(&mut self) {
        if self.writer.is_some() {
            // No caller is left to report an error to.
            let _ = self.end();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Backlog> {
        // No code panics while it holds the lock. If one did, only the counts could be wrong.
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs the disk's side: writes until the stream has ended, and returns the length of the file.
    fn write<S: Sink>(&self, mut disk: Disk<S>) -> Result<u64, FileError> {
        let mut failure = None;
        let mut synced = self.clock.now();
        let mut dirty = false;
        loop {
            let mut backlog = self.lock();
            let item = backlog.pop();
            if item.is_none() {
                if backlog.has_ended() {
                    break;
                }
                backlog = self
                    .changed
                    .wait_timeout(backlog, Duration::from_micros(SYNC_INTERVAL.0))
                    .map_or_else(|error| error.into_inner().0, |(backlog, _)| backlog);
            }
            drop(backlog);
            let mut problem = None;
            if let Some(item) = item {
                match disk.append(item.arrival, &item.frame) {
                    Ok(()) => self.lock().wrote(&item),
                    Err(error) => problem = Some((error, Some(item))),
                }
                dirty = true;
            }
            if problem.is_none() && dirty && self.clock.now().since(synced) >= SYNC_INTERVAL {
                problem = disk.sync().err().map(|error| (DiskError::Io(error), None));
                (dirty, synced) = (false, self.clock.now());
            }
            let Some((error, item)) = problem else { continue };
            let gone = matches!(&error, DiskError::Io(error) if error.kind() == ErrorKind::NotFound);
            self.lock().failed(item, self.clock.now(), gone);
            if failure.is_none() {
                let error = disk.describe(error);
                (self.observer)(RecorderNotice::Failed(&error));
                failure = Some(error);
            }
        }
        let finished = disk.finish().map_err(|error| disk.describe(error));
        failure.map_or(finished, Err)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::disallowed_methods, reason = "a test waits for the disk")]

    use std::io::{Error, ErrorKind, Result};
    use std::path::Path;
    use std::sync::mpsc;

    use psao_codec::envelope::{EncodedFrame, FrameKind};

    use super::*;
    use crate::message::{Close, CloseCode};
    use crate::recording::file::Recorder;
    use crate::recording::{Player, StoredIndex, Summary};
    use crate::sample::SampleServer;
    use crate::{FrameType, Limits};

    /// A disk in memory that can be slow or full.
    #[derive(Clone)]
    struct MemorySink {
        file: Arc<Mutex<Vec<u8>>>,
        /// Its capacity in bytes.
        room: Arc<Mutex<usize>>,
        /// With a gate, each write waits for one message.
        gate: Option<Arc<Mutex<mpsc::Receiver<()>>>>,
    }

    impl MemorySink {
        fn new(room: usize) -> Self {
            Self { file: Arc::default(), room: Arc::new(Mutex::new(room)), gate: None }
        }
    }

    impl Sink for MemorySink {
        fn path(&self) -> &Path {
            Path::new("memory")
        }

        fn put(&mut self, bytes: &[u8]) -> Result<()> {
            if let Some(gate) = &self.gate {
                // Once the sender is dropped, writes no longer wait.
                let _ = gate.lock().unwrap().recv();
            }
            let mut file = self.file.lock().unwrap();
            let free = self.room.lock().unwrap().saturating_sub(file.len());
            file.extend_from_slice(&bytes[..free.min(bytes.len())]);
            if free < bytes.len() { Err(ErrorKind::StorageFull.into()) } else { Ok(()) }
        }

        fn truncate(&mut self, length: u64) -> Result<()> {
            self.file.lock().unwrap().truncate(length as usize);
            Ok(())
        }

        fn sync(&mut self) -> Result<()> {
            Ok(())
        }
    }

    /// Records `frames` frames, with a keyframe whenever the recorder wants one.
    fn stream(recorder: &mut Recorder, server: &mut SampleServer, frames: u32) {
        for _ in 0..frames {
            let EncodedFrame { info, body, .. } = server.step().unwrap();
            let now = recorder.now();
            match recorder.wants_keyframe(recorder.now()) {
                true => recorder.body(now, FrameKind::Key, &server.keyframe().unwrap()).unwrap(),
                false => recorder.body(now, info.kind, &body).unwrap(),
            }
        }
    }

    fn recorder(sink: &MemorySink, buffer: usize) -> Recorder {
        Recorder::over(sink.clone(), RecorderOptions::default().with_buffer_bytes(buffer))
    }

    fn played(file: &[u8]) -> (u64, u64, StoredIndex) {
        let mut player = Player::new(file, Limits::default()).unwrap();
        while player.next_event().is_some() {}
        let stats = player.stats();
        assert!(stats.is_clean(), "{stats:?}");
        let summary = Summary::scan(file, Limits::default()).unwrap();
        (stats.applied, stats.gap_frames, summary.stored_index())
    }

    #[test]
    fn a_slow_disk_never_stops_the_stream_and_the_gap_is_marked() {
        let (words, gate) = mpsc::channel();
        let sink = MemorySink { gate: Some(Arc::new(Mutex::new(gate))), ..MemorySink::new(usize::MAX) };
        let mut server = SampleServer::new().unwrap();
        let mut recorder = recorder(&sink, 3000);
        recorder.scene(server.scene()).unwrap();
        // The disk writes nothing meanwhile, so the buffer overflows.
        stream(&mut recorder, &mut server, 200);
        assert_eq!(sink.file.lock().unwrap().len(), 0);
        drop(words);
        while !recorder.wants_keyframe(recorder.now()) {
            std::thread::yield_now();
        }
        stream(&mut recorder, &mut server, 5);
        recorder.message(recorder.now(), &Close::new(CloseCode::DONE, "")).unwrap();
        recorder.finish().unwrap();
        let file = sink.file.lock().unwrap();
        let (applied, missing, index) = played(&file);
        assert_eq!((applied + missing, index), (205, StoredIndex::Agrees));
        assert!((6..100).contains(&applied), "{applied} frames were written");
        assert_eq!(Summary::scan(&file, Limits::default()).unwrap().count(FrameType::CLOSE).frames, 1);
    }

    #[test]
    fn a_full_disk_keeps_what_was_written_and_goes_on_when_there_is_room() {
        let sink = MemorySink::new(4000);
        let mut server = SampleServer::new().unwrap();
        let mut recorder = recorder(&sink, 1 << 20);
        recorder.scene(server.scene()).unwrap();
        stream(&mut recorder, &mut server, 100);
        while recorder.missing().frames == 0 {
            std::thread::yield_now();
        }
        *sink.room.lock().unwrap() = usize::MAX;
        while !recorder.wants_keyframe(recorder.now()) {
            std::thread::sleep(Duration::from_millis(10));
        }
        stream(&mut recorder, &mut server, 10);
        let failure = recorder.finish().unwrap_err();
        assert!(matches!(failure, FileError::Io { .. }), "{failure}");
        let (applied, missing, index) = played(&sink.file.lock().unwrap());
        assert_eq!((applied + missing, index), (110, StoredIndex::Agrees));
        assert!(applied >= 20, "{applied} frames were written");
    }

    #[test]
    fn a_disk_that_stays_full_leaves_whole_records() {
        for room in [0, 10, 500, 2001, 4002] {
            let sink = MemorySink::new(room);
            let mut server = SampleServer::new().unwrap();
            let mut recorder = recorder(&sink, 1 << 20);
            recorder.scene(server.scene()).unwrap();
            stream(&mut recorder, &mut server, 60);
            assert!(recorder.finish().is_err());
            let file = sink.file.lock().unwrap();
            if !file.is_empty() {
                played(&file);
            }
        }
    }

    #[test]
    fn failures_name_the_file() {
        let disk = Disk::new(MemorySink::new(0), Limits::default());
        let failure = disk.describe(DiskError::Io(Error::from(ErrorKind::PermissionDenied)));
        assert!(failure.to_string().contains("memory"), "{failure}");
    }

    #[test]
    fn a_recorder_that_is_dropped_leaves_a_whole_recording() {
        let sink = MemorySink::new(usize::MAX);
        let mut server = SampleServer::new().unwrap();
        let mut recorder = recorder(&sink, 1 << 20);
        recorder.scene(server.scene()).unwrap();
        stream(&mut recorder, &mut server, 20);
        drop(recorder);
        assert_eq!(played(&sink.file.lock().unwrap()), (20, 0, StoredIndex::Agrees));
    }

    #[test]
    fn notices_come_once_each() {
        let (notices, heard) = mpsc::channel();
        let observer = move |notice: RecorderNotice<'_>| notices.send(notice.to_string()).unwrap();
        let options = RecorderOptions::default().with_buffer_bytes(1 << 20).with_observer(observer);
        let mut recorder = Recorder::over(MemorySink::new(0), options);
        let mut server = SampleServer::new().unwrap();
        recorder.scene(server.scene()).unwrap();
        while recorder.missing().frames == 0 {
            stream(&mut recorder, &mut server, 1);
        }
        // This frame falls into the gap.
        stream(&mut recorder, &mut server, 1);
        recorder.finish().unwrap_err();
        let heard: Vec<String> = heard.into_iter().collect();
        assert_eq!(heard.len(), 3, "{heard:?}");
        for words in ["cannot keep up", "the stream goes on", "are missing from the recording"] {
            assert_eq!(heard.iter().filter(|notice| notice.contains(words)).count(), 1, "{heard:?}");
        }
    }
}
