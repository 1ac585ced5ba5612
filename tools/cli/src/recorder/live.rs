//! A recording behind the back of its stream: a thread of its own writes, and the stream never waits for it.

use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use psao_proto::Micros;

use super::Tape;
use super::backlog::{Backlog, Missing};
use super::disk::{Disk, DiskError, Sink};
use crate::context::Stopwatch;
use crate::error::{Exit, Failure, Outcome};
use crate::output::number;

/// How often what was written is brought to the disk: what a power cut may cost.
const SETTLE: Duration = Duration::from_secs(1);

/// The near end: takes frames and never waits.
pub(crate) struct Live {
    path: PathBuf,
    shared: Arc<Shared>,
    writer: JoinHandle<Written>,
    /// Whether it was said that the disk is too slow.
    told: bool,
}

struct Shared {
    backlog: Mutex<Backlog>,
    changed: Condvar,
    clock: Stopwatch,
}

/// How the writing went.
struct Written {
    /// Length of the file, if its end could be written.
    bytes: Option<u64>,
    /// The first failure.
    failure: Option<Failure>,
}

impl Live {
    /// Starts a recording of which at most `buffer` bytes wait.
    pub(crate) fn start(sink: impl Sink, buffer: usize) -> Outcome<Self> {
        let path = sink.path().to_owned();
        let shared = Arc::new(Shared {
            backlog: Mutex::new(Backlog::new(buffer)),
            changed: Condvar::new(),
            clock: Stopwatch::start(),
        });
        let far = Arc::clone(&shared);
        let writer = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || far.write(Disk::new(sink)))
            .map_err(|error| Failure::new(Exit::System, format_args!("cannot start a thread: {error}")))?;
        Ok(Self { path, shared, writer, told: false })
    }

    /// Time since the recording began.
    pub(crate) fn now(&self) -> Micros {
        Micros(self.shared.clock.micros())
    }

    /// Whether a keyframe would end a gap.
    pub(crate) fn wants_keyframe(&self) -> bool {
        self.shared.lock().wants_keyframe(self.now())
    }

    /// Writes what waits and ends the recording; gives the length of the file.
    pub(crate) fn finish(self) -> Outcome<u64> {
        let now = self.now();
        self.shared.lock().end(now);
        self.shared.changed.notify_one();
        let path = self.path.display();
        let written = self
            .writer
            .join()
            .map_err(|_| Failure::new(Exit::System, format_args!("{path}: the recorder's thread failed")))?;
        let Missing { gaps, frames, bytes } = self.shared.lock().missing();
        if gaps > 0 {
            eprintln!(
                "psao: {path}: {} frames ({}) are missing from the recording, in {gaps} gap(s)",
                number::count(frames),
                number::bytes(bytes)
            );
        }
        match (written.failure, written.bytes) {
            (None, Some(bytes)) => Ok(bytes),
            (Some(failure), _) => Err(failure),
            (None, None) => Err(Failure::new(Exit::System, format_args!("{path}: its end was not written"))),
        }
    }
}

impl Tape for Live {
    fn take(&mut self, arrival: Micros, frame: &[u8]) -> Outcome {
        let taken = self.shared.lock().offer(arrival, frame);
        self.shared.changed.notify_one();
        if !taken && !self.told {
            self.told = true;
            eprintln!(
                "psao: {}: the recording cannot keep up; frames are missing until it goes on with a keyframe",
                self.path.display()
            );
        }
        Ok(())
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Backlog> {
        // Nothing panics under the lock; if something did, the counts are all that may be off.
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The far end: writes until the stream has ended.
    fn write<S: Sink>(&self, mut disk: Disk<S>) -> Written {
        let mut failure = None;
        let mut settled = Instant::now();
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
                    .wait_timeout(backlog, SETTLE)
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
            if problem.is_none() && dirty && settled.elapsed() >= SETTLE {
                problem = disk.settle().err().map(|error| (DiskError::Io(error), None));
                (dirty, settled) = (false, Instant::now());
            }
            let Some((error, item)) = problem else { continue };
            let gone = matches!(&error, DiskError::Io(error) if error.kind() == std::io::ErrorKind::NotFound);
            self.lock().failed(item, Micros(self.clock.micros()), gone);
            failure.get_or_insert_with(|| {
                let failure = disk.failure(&error);
                eprintln!("psao: {failure}; the stream goes on");
                failure
            });
        }
        let bytes = disk.finish();
        if let Err(error) = &bytes {
            failure.get_or_insert_with(|| disk.failure(error));
        }
        Written { bytes: bytes.ok(), failure }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind, Result};
    use std::path::Path;
    use std::sync::mpsc;

    use psao_proto::message::{Close, CloseCode};
    use psao_proto::recording::{Player, StoredIndex, Summary};
    use psao_proto::sample::SampleServer;
    use psao_proto::{FrameType, Limits, Numbering};

    use super::*;
    use crate::recorder::Recorder;

    /// A disk in memory, that can be told to wait and to be full.
    #[derive(Clone)]
    struct Memory {
        file: Arc<Mutex<Vec<u8>>>,
        /// Most bytes that it holds.
        room: Arc<Mutex<usize>>,
        /// It writes once for each word it gets; without, it writes at once.
        gate: Option<Arc<Mutex<mpsc::Receiver<()>>>>,
    }

    impl Memory {
        fn new(room: usize) -> Self {
            Self { file: Arc::default(), room: Arc::new(Mutex::new(room)), gate: None }
        }
    }

    impl Sink for Memory {
        fn path(&self) -> &Path {
            Path::new("memory")
        }

        fn put(&mut self, bytes: &[u8]) -> Result<()> {
            if let Some(gate) = &self.gate {
                // A sender that is gone lets everything pass.
                let _ = gate.lock().unwrap().recv();
            }
            let mut file = self.file.lock().unwrap();
            let free = self.room.lock().unwrap().saturating_sub(file.len());
            file.extend_from_slice(&bytes[..free.min(bytes.len())]);
            if free < bytes.len() { Err(ErrorKind::StorageFull.into()) } else { Ok(()) }
        }

        fn cut_back(&mut self, length: u64) -> Result<()> {
            self.file.lock().unwrap().truncate(length as usize);
            Ok(())
        }

        fn settle(&mut self) -> Result<()> {
            Ok(())
        }
    }

    /// A stream into a recorder; a keyframe whenever it is wanted.
    fn stream(recorder: &mut Recorder<Live>, server: &mut SampleServer, frames: u32) {
        for _ in 0..frames {
            let body = server.step().unwrap().body;
            let (now, first) = (recorder.now(), server.state().frame().unwrap().0 == 0);
            match recorder.wants_keyframe() {
                true => recorder.body(now, true, &server.keyframe().unwrap()).unwrap(),
                false => recorder.body(now, first, &body).unwrap(),
            }
        }
    }

    fn recorder(sink: &Memory, buffer: usize) -> Recorder<Live> {
        let tape = Live::start(sink.clone(), buffer).unwrap();
        Recorder { tape, numbering: Numbering::default() }
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
        let sink = Memory { gate: Some(Arc::new(Mutex::new(gate))), ..Memory::new(usize::MAX) };
        let mut server = SampleServer::new().unwrap();
        let mut recorder = recorder(&sink, 3000);
        recorder.scene(server.scene()).unwrap();
        // Nothing is written meanwhile: far more goes in than the buffer holds.
        stream(&mut recorder, &mut server, 200);
        assert_eq!(sink.file.lock().unwrap().len(), 0);
        drop(words);
        while !recorder.wants_keyframe() {
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
        let sink = Memory::new(4000);
        let mut server = SampleServer::new().unwrap();
        let mut recorder = recorder(&sink, 1 << 20);
        recorder.scene(server.scene()).unwrap();
        stream(&mut recorder, &mut server, 100);
        while recorder.tape.shared.lock().missing().frames == 0 {
            std::thread::yield_now();
        }
        *sink.room.lock().unwrap() = usize::MAX;
        while !recorder.wants_keyframe() {
            std::thread::sleep(Duration::from_millis(10));
        }
        stream(&mut recorder, &mut server, 10);
        let failure = recorder.finish().unwrap_err();
        assert_eq!(failure.exit, Exit::System);
        let (applied, missing, index) = played(&sink.file.lock().unwrap());
        assert_eq!((applied + missing, index), (110, StoredIndex::Agrees));
        assert!(applied >= 20, "{applied} frames were written");
    }

    #[test]
    fn a_disk_that_stays_full_leaves_whole_records() {
        for room in [0, 10, 500, 2001, 4002] {
            let sink = Memory::new(room);
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
    fn failures_that_are_not_the_disks_say_so() {
        let disk = Disk::new(Memory::new(0));
        let failure = disk.failure(&DiskError::Io(Error::from(ErrorKind::PermissionDenied)));
        assert!(failure.to_string().contains("memory") && failure.exit == Exit::System);
    }
}
