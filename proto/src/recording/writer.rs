//! Writing a recording: the bytes to append.

use psao_codec::envelope::{FrameBody, FrameInfo};

use super::index::{IndexEntry, write_index};
use super::parity::ParityWriter;
use super::{file_header, footer, record_head};
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
    /// The bytes end inside a frame, or continue after it.
    #[error("not one whole frame: {given} bytes given, the frame has {frame}")]
    Length {
        /// Bytes given.
        given: usize,
        /// Bytes of the frame, as far as its start shows.
        frame: usize,
    },
    /// An earlier write failed, so the end of the file is unknown.
    #[error(
        "an earlier write to this recording failed; what was written before it can still be read. Start a new file"
    )]
    Poisoned,
    /// [`Writer::finish`] was called before.
    #[error("this recording was finished already")]
    Finished,
}

/// Returns the bytes to append to a recording. A writer does no I/O: the caller appends the bytes, and reports a
/// failure with [`take_back`](Self::take_back) or [`fail`](Self::fail).
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
    parity: ParityWriter,
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
    /// Creates a writer and returns the file header, which comes first.
    #[must_use]
    pub fn new(limits: Limits) -> (Self, Vec<u8>) {
        let head = file_header().to_vec();
        let length = head.len() as u64;
        let parity = ParityWriter::new(&head);
        let writer = Self {
            limits,
            length,
            before: length,
            index: Vec::new(),
            parity,
            last_arrival: Micros::default(),
            state: Status::Open,
        };
        (writer, head)
    }

    /// Returns the record of one wire frame, to append to the file; parity records follow it when it is time.
    /// `arrival` is the time since the start of the recording.
    ///
    /// # Errors
    /// [`WriterError`]; the recording is unchanged.
    pub fn append(&mut self, arrival: Micros, frame: &[u8]) -> Result<Vec<u8>, WriterError> {
        let header = self.check_frame(frame)?;
        // A body that cannot be parsed is recorded, but has no entry in the index.
        let parse = || FrameBody::parse(&frame[HEADER_BYTES..], &self.limits.codec).ok();
        let body = if header.kind == FrameType::KEYFRAME { parse() } else { None };
        self.enter(header, frame, body.as_ref().map(FrameBody::info));
        Ok(self.record(arrival, frame))
    }

    /// Does the same as [`append`](Self::append) for a frame whose body was parsed before. `info` is the header of that
    /// body; without it the frame gets no entry in the index.
    pub(super) fn append_parsed(
        &mut self,
        arrival: Micros,
        frame: &[u8],
        info: Option<&FrameInfo>,
    ) -> Result<Vec<u8>, WriterError> {
        let header = self.check_frame(frame)?;
        self.enter(header, frame, info);
        Ok(self.record(arrival, frame))
    }

    /// Enters the next record into the index, if it belongs there.
    fn enter(&mut self, header: FrameHeader, frame: &[u8], info: Option<&FrameInfo>) {
        self.index.extend(IndexEntry::of(self.length, header.kind, &frame[HEADER_BYTES..], info));
    }

    /// Returns the last parity record, the index and the footer. They are optional: a reader scans a recording without an
    /// index once.
    ///
    /// # Errors
    /// [`WriterError::Poisoned`] and [`WriterError::Finished`].
    pub fn finish(&mut self) -> Result<Vec<u8>, WriterError> {
        self.check_open()?;
        let mut out = self.parity.finish(self.last_arrival);
        let offset = self.length + out.len() as u64;
        record_head(self.last_arrival, &mut out);
        let payload = write_index(&self.index);
        write_frame(&mut out, FrameType::INDEX, Group(0), Sequence(0), &payload)
            .map_err(WriterError::NotAFrame)?;
        out.extend_from_slice(&footer(offset));
        self.length += out.len() as u64;
        self.state = Status::Finished;
        Ok(out)
    }

    /// Takes back the last record after a write that failed, with its entry in the index and the parity behind it.
    /// The caller must truncate the file to the end of the record before it. A second call, or one after
    /// [`finish`](Self::finish), has no effect.
    pub fn take_back(&mut self) {
        if self.state == Status::Open {
            self.length = self.before;
            self.parity.take_back();
            self.index.pop_if(|entry| entry.offset >= self.before);
        }
    }

    /// Marks the recording as failed, because a write failed and the file was not truncated. Every later call returns
    /// [`WriterError::Poisoned`].
    pub fn fail(&mut self) {
        self.state = Status::Failed;
    }

    /// Returns whether [`fail`](Self::fail) was called.
    #[must_use]
    pub fn is_poisoned(&self) -> bool {
        self.state == Status::Failed
    }

    /// Returns the bytes of the file so far.
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

    /// Checks that a record may follow and that `frame` is one whole wire frame. Returns its header.
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
        record_head(arrival, &mut out);
        out.extend_from_slice(frame);
        let parity = self.parity.push(arrival, &out);
        out.extend(parity);
        self.before = self.length;
        self.length += out.len() as u64;
        self.last_arrival = arrival;
        out
    }
}
