//! Writing a recording: which bytes to append.

use psao_codec::envelope::{FrameBody, FrameInfo};

use super::index::{IndexEntry, write_index};
use super::{file_header, footer};
use crate::framer::{Split, split_frame};
use crate::{
    FrameHeader, FrameType, Group, HEADER_BYTES, Limits, Micros, Sequence, WireFrameError, write_frame,
};

/// Why nothing was appended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WriterError {
    /// The bytes are not exactly one whole frame.
    #[error("not one whole frame: {0}")]
    NotAFrame(WireFrameError),
    /// The bytes end inside a frame, or go on after it.
    #[error("not one whole frame: {given} bytes given, the frame has {frame}")]
    Length {
        /// Bytes given.
        given: usize,
        /// Bytes of the frame, as far as its start tells.
        frame: usize,
    },
    /// An earlier write failed, so that what the file ends with is unknown.
    #[error(
        "an earlier write to this recording failed; what was written before it can still be read. Start a new file"
    )]
    Poisoned,
    /// [`Writer::finish`] was called before.
    #[error("this recording was finished already")]
    Finished,
}

/// Says which bytes to append to a recording. Does no I/O: the caller appends, and reports a failure with
/// [`fail`](Self::fail).
///
/// ```
/// use psao_proto::recording::{Reader, Writer};
/// use psao_proto::{FrameType, Group, Limits, Micros, Sequence, write_frame};
///
/// let mut frame = Vec::new();
/// write_frame(&mut frame, FrameType::CLOSE, Group(0), Sequence(0), &[0; 10])?;
///
/// let mut file = Vec::new(); // or a std::fs::File and write_all
/// let (mut writer, head) = Writer::new(Limits::default());
/// file.extend_from_slice(&head);
/// file.extend_from_slice(&writer.append(Micros(1_000), &frame)?);
/// file.extend_from_slice(&writer.finish()?); // optional: the index
///
/// let records: Vec<_> = Reader::new(&file)?.collect::<Result<_, _>>()?;
/// assert_eq!(records[0].frame.bytes, frame);
/// assert_eq!(records[0].arrival, Micros(1_000));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Writer {
    limits: Limits,
    /// Bytes of the file so far.
    length: u64,
    /// Bytes of the file before the last record.
    before: u64,
    index: Vec<IndexEntry>,
    last_arrival: Micros,
    state: Status,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    Open,
    Failed,
    Finished,
}

impl Writer {
    /// A writer, and the file header to write first.
    #[must_use]
    pub fn new(limits: Limits) -> (Self, Vec<u8>) {
        let head = file_header().to_vec();
        let length = head.len() as u64;
        let writer = Self {
            limits,
            length,
            before: length,
            index: Vec::new(),
            last_arrival: Micros::default(),
            state: Status::Open,
        };
        (writer, head)
    }

    /// The record of one frame, given as it was on the wire, to append to the file. `arrival` is the time since the
    /// start of the recording.
    ///
    /// # Errors
    /// [`WriterError`]; the recording is then as if this was never called.
    pub fn append(&mut self, arrival: Micros, frame: &[u8]) -> Result<Vec<u8>, WriterError> {
        let header = self.check_frame(frame)?;
        if header.kind.carries_state()
            // A body that cannot be read is recorded as it came, but an index cannot name it.
            && let Ok(body) = FrameBody::parse(&frame[HEADER_BYTES..], &self.limits.codec)
        {
            self.index.push(IndexEntry::new(self.length, header, body.info()));
        }
        Ok(self.record(arrival, frame))
    }

    /// As [`append`](Self::append), for a frame whose body was parsed before: `info` is the header of that body. Without
    /// it the frame gets no entry in the index.
    pub(super) fn append_parsed(
        &mut self,
        arrival: Micros,
        frame: &[u8],
        info: Option<&FrameInfo>,
    ) -> Result<Vec<u8>, WriterError> {
        let header = self.check_frame(frame)?;
        self.index.extend(info.map(|info| IndexEntry::new(self.length, header, info)));
        Ok(self.record(arrival, frame))
    }

    /// The index and the footer. A recording without them is as good; a reader then scans it once.
    ///
    /// # Errors
    /// [`WriterError::Poisoned`] and [`WriterError::Finished`].
    pub fn finish(&mut self) -> Result<Vec<u8>, WriterError> {
        self.check_open()?;
        let offset = self.length;
        let mut frame = Vec::new();
        let payload = write_index(&self.index);
        write_frame(&mut frame, FrameType::INDEX, Group(0), Sequence(0), &payload)
            .map_err(WriterError::NotAFrame)?;
        let mut out = self.record(self.last_arrival, &frame);
        out.extend_from_slice(&footer(offset));
        self.state = Status::Finished;
        Ok(out)
    }

    /// Forgets the record given last, which could not be written: the caller has cut the file back to what was there
    /// before, or will before the next write. Does nothing twice, and nothing after [`finish`](Self::finish).
    pub fn take_back(&mut self) {
        if self.state == Status::Open {
            self.length = self.before;
            self.index.pop_if(|entry| entry.offset >= self.before);
        }
    }

    /// Tells the writer that bytes it gave could not be written. Everything after this is refused: it would follow a
    /// record cut in the middle.
    pub fn fail(&mut self) {
        self.state = Status::Failed;
    }

    /// Whether [`fail`](Self::fail) was called.
    #[must_use]
    pub fn is_poisoned(&self) -> bool {
        self.state == Status::Failed
    }

    /// Bytes of the file so far.
    #[must_use]
    pub const fn file_bytes(&self) -> u64 {
        self.length
    }

    fn check_open(&self) -> Result<(), WriterError> {
        match self.state {
            Status::Open => Ok(()),
            Status::Failed => Err(WriterError::Poisoned),
            Status::Finished => Err(WriterError::Finished),
        }
    }

    /// Returns the header of the one whole frame that `frame` is, if a record may follow.
    fn check_frame(&self, frame: &[u8]) -> Result<FrameHeader, WriterError> {
        self.check_open()?;
        let given = frame.len();
        match split_frame(frame, &self.limits).map_err(WriterError::NotAFrame)? {
            Split::Whole(header, bytes) if bytes.len() == given => Ok(header),
            Split::Whole(_, bytes) => Err(WriterError::Length { given, frame: bytes.len() }),
            Split::Partial(bytes) => Err(WriterError::Length { given, frame: bytes }),
        }
    }

    fn record(&mut self, arrival: Micros, frame: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(super::RECORD_HEAD_BYTES + frame.len());
        let time = arrival.0.to_le_bytes();
        out.extend_from_slice(&time);
        out.extend_from_slice(&crc32c::crc32c(&time).to_le_bytes());
        out.extend_from_slice(frame);
        self.before = self.length;
        self.length += out.len() as u64;
        self.last_arrival = arrival;
        out
    }
}
