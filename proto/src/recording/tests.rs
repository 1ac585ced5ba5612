//! Recordings of the sample stream: played whole, cut, damaged and indexed.

use super::*;
use crate::message::{Close, CloseCode, Edit, EditAction};
use crate::sample::{SampleServer, recording};
use crate::{FollowError, FrameIndex, FrameType, Limits, Micros, Numbering, StateHash};

/// Plays a file. Returns applied frames and their hashes, and the player's counts.
fn play(file: &[u8]) -> (Vec<(u32, StateHash)>, PlayerStats) {
    let mut player = Player::new(file, Limits::default()).unwrap();
    let mut frames = Vec::new();
    while let Some(event) = player.next_event() {
        if let PlayerEvent::Frame(frame) = event {
            let state = player.state().unwrap();
            assert_eq!((state.hash(), state.full_hash()), (frame.info.hash, frame.info.hash));
            let body = frame.body(file);
            assert_eq!(psao_codec::envelope::inspect(body, &Limits::default().codec).unwrap(), frame.info);
            assert_eq!(body.len() as u64 + crate::HEADER_BYTES as u64, frame.wire_bytes);
            assert!(frame.body(&file[..frame.offset as usize]).is_empty());
            frames.push((frame.info.frame.0, frame.info.hash));
        }
    }
    (frames, player.stats())
}

/// Returns the hash after each frame of the sample.
fn hashes(count: u32) -> Vec<(u32, StateHash)> {
    let mut server = SampleServer::new().unwrap();
    (0..count).map(|n| (n, server.step().unwrap().info.hash)).collect()
}

#[test]
fn a_whole_recording_plays_to_the_servers_hashes() {
    let file = recording(10, 4).unwrap();
    let (frames, stats) = play(&file);
    assert_eq!(frames, hashes(10));
    assert!(stats.is_clean() && stats.applied == 10, "{stats:?}");

    let summary = Summary::scan(&file, Limits::default()).unwrap();
    assert_eq!(summary.stored_index(), StoredIndex::Agrees);
    assert_eq!((summary.groups(), summary.frames().len(), summary.damages()), (3, 10, &[][..]));
    assert_eq!(summary.index().len(), 1 + 3, "a scene table, three groups");
    assert_eq!(summary.count(FrameType::KEYFRAME).frames, 3);
    assert_eq!(summary.count(FrameType::REPORT).frames, 10);
    assert_eq!(summary.close().unwrap().code, CloseCode::DONE);
    assert_eq!(summary.duration(), Micros(166_670));
    let records: u64 = summary.types().values().map(|c| c.record_bytes).sum();
    assert_eq!(records + (FILE_HEADER_BYTES + FOOTER_BYTES) as u64, summary.file_bytes());
    let heads = 12 * summary.types().values().map(|c| c.frames).sum::<u64>();
    let beside = [FrameType::INDEX, FrameType::PARITY].map(|kind| summary.count(kind).wire_bytes);
    assert_eq!(records - heads - beside.iter().sum::<u64>(), summary.wire_bytes());
}

#[test]
fn edits_are_played_in_their_place() {
    let edit = Edit { instance: 1, action: EditAction::Hide };
    let mut server = SampleServer::new().unwrap();
    let mut numbering = Numbering::default();
    let (mut writer, mut file) = Writer::new(Limits::default());
    let mut frames = numbering.scene(server.scene()).unwrap();
    server.step().unwrap();
    frames.push(numbering.keyframe(&server.keyframe().unwrap()).unwrap());
    frames.push(numbering.message(&edit).unwrap());
    // An invalid edit, which no program of this version writes, is reported, and playing continues.
    let mut bad = Vec::new();
    crate::write_frame(&mut bad, FrameType::EDIT, crate::Group(1), crate::Sequence(0), &[1; 5]).unwrap();
    frames.push(bad);
    frames.push(numbering.update(&server.step().unwrap().body).unwrap());
    for frame in frames {
        file.extend(writer.append(Micros(0), &frame).unwrap());
    }
    let mut player = Player::new(&file, Limits::default()).unwrap();
    let events: Vec<_> = std::iter::from_fn(|| player.next_event()).collect();
    let number = |event: &PlayerEvent| match event {
        PlayerEvent::Frame(frame) => Some(frame.info.frame.0),
        _ => None,
    };
    let [PlayerEvent::Scene(_), first, heard, PlayerEvent::BadMessage { .. }, second] = &events[..] else {
        panic!("{events:?}");
    };
    assert_eq!((number(first), heard, number(second)), (Some(0), &PlayerEvent::Edit(edit), Some(1)));
    assert_eq!(player.stats().bad_messages, 1);
}

#[test]
fn the_index_is_rebuilt_when_it_is_missing_or_wrong() {
    let file = recording(10, 4).unwrap();
    let whole = load_index(&file, Limits::default()).unwrap();
    let records = Summary::scan(&file, Limits::default()).unwrap();
    let end = [FrameType::INDEX, FrameType::PARITY].map(|kind| records.count(kind).record_bytes as usize);
    let cut = file.len() - FOOTER_BYTES - end.iter().sum::<usize>();
    let summary = Summary::scan(&file[..cut], Limits::default()).unwrap();
    assert_eq!((summary.stored_index(), summary.index()), (StoredIndex::Missing, &whole[..]));
    assert_eq!(load_index(&file[..cut], Limits::default()).unwrap(), whole);
    assert_eq!(load_index(&file[..file.len() - 1], Limits::default()).unwrap(), whole);

    // Records after an index make it old, because the file then ends without a footer.
    let mut longer = file.clone();
    longer.extend_from_slice(&file[FILE_HEADER_BYTES..cut]);
    let summary = Summary::scan(&longer, Limits::default()).unwrap();
    assert_eq!((summary.stored_index(), summary.index().len()), (StoredIndex::Differs, 8));
    assert_eq!(load_index(&longer, Limits::default()).unwrap(), summary.index());
}

#[test]
fn seeking_goes_to_a_keyframe_and_on_from_there() {
    let file = recording(10, 4).unwrap();
    let summary = Summary::scan(&file, Limits::default()).unwrap();
    let mut player = Player::new(&file, Limits::default()).unwrap();
    let Some(PlayerEvent::Scene(_)) = player.next_event() else { panic!() };
    for (wanted, found) in [(9, 8), (6, 4), (4, 4), (0, 0)] {
        let entry = summary.keyframe_before(FrameIndex(wanted)).unwrap();
        player.seek(entry);
        let Some(PlayerEvent::Frame(frame)) = player.next_event() else { panic!() };
        assert_eq!((frame.info.frame.0, frame.offset), (found, entry.offset));
        assert_eq!((found, player.state().unwrap().hash()), hashes(10)[found as usize]);
    }
    assert!(player.stats().is_clean());
}

#[test]
fn a_recording_cut_anywhere_plays_its_whole_frames() {
    let file = recording(5, 3).unwrap();
    let reader = Reader::new(&file).unwrap();
    let ends: Vec<u64> = reader
        .map(Result::unwrap)
        .filter(|r| r.frame.header.kind.carries_state())
        .map(|r| r.offset() + r.record_bytes())
        .collect();
    assert_eq!(ends.len(), 5);
    let expected = hashes(5);
    for end in FILE_HEADER_BYTES..file.len() {
        let whole = ends.iter().filter(|&&e| e <= end as u64).count();
        let (frames, stats) = play(&file[..end]);
        assert_eq!(frames, expected[..whole], "cut at {end}");
        assert!(stats.damages <= 1 && stats.unusable == 0);
    }
}

#[test]
fn any_flipped_byte_is_reported_and_never_gives_a_wrong_state() {
    let file = recording(7, 3).unwrap();
    let expected = hashes(7);
    let index = Summary::scan(&file, Limits::default()).unwrap().frames().to_vec();
    for place in 0..file.len() {
        let mut bad = file.clone();
        bad[place] ^= 0x40;
        let mut player = Player::new(&bad, Limits::default()).unwrap();
        let mut frames = Vec::new();
        while let Some(event) = player.next_event() {
            match event {
                PlayerEvent::Frame(f) => frames.push((f.info.frame.0, f.info.hash)),
                PlayerEvent::Unusable { reason, .. } => {
                    let known = matches!(
                        reason,
                        FollowError::Gap { .. } | FollowError::Waiting | FollowError::NoScene
                    );
                    assert!(known, "byte {place}: {reason}");
                }
                _ => {}
            }
        }
        let stats = player.stats();
        assert_eq!(stats.damages, 1, "byte {place}");
        assert!(frames.iter().all(|f| expected.contains(f)), "byte {place}");
        // All frames are accounted for, whichever was damaged.
        let hit = index.iter().rposition(|e| (e.offset as usize) <= place);
        let end = hit.and_then(|h| {
            Reader::new(&file).unwrap().map(Result::unwrap).find(|r| r.offset() == index[h].offset)
        });
        match (hit, end) {
            (Some(h), Some(record)) if (place as u64) < record.offset() + record.record_bytes() => {
                // The rest of its group is lost, but no later group.
                let group_end = index[h + 1..].iter().position(|e| e.keyframe).map_or(7, |n| h + 1 + n);
                let kept: Vec<_> = [&expected[..h], &expected[group_end..]].concat();
                assert_eq!(frames, kept, "byte {place}");
                assert_eq!(stats.unusable as usize, group_end - h - 1, "byte {place}");
                // The loss of frame 6, the last, and of frame 0, the first, does not show.
                let untold = h == 6 || h == 0;
                assert!(stats.lost == 1 || untold, "byte {place}: {stats:?}");
            }
            _ => assert!(frames.len() == 7 || frames.is_empty(), "byte {place}: {stats:?}"),
        }
    }
}

#[test]
fn a_writer_that_failed_or_finished_writes_no_more() {
    let frame = Numbering::default().keyframe(b"any").unwrap();
    let (mut writer, _) = Writer::new(Limits::default());
    assert!(matches!(
        writer.append(Micros(0), &frame[..22]),
        Err(WriterError::Length { given: 22, frame: 23 })
    ));
    let two = [&frame[..], &frame].concat();
    assert!(matches!(writer.append(Micros(0), &two), Err(WriterError::Length { given: 46, frame: 23 })));
    assert!(matches!(writer.append(Micros(0), b"hello, world"), Err(WriterError::NotAFrame(_))));
    assert_eq!(writer.file_bytes(), FILE_HEADER_BYTES as u64, "a refused frame leaves no trace");
    writer.append(Micros(0), &frame).unwrap();
    writer.fail();
    assert!(writer.is_poisoned());
    assert_eq!(writer.append(Micros(1), &frame), Err(WriterError::Poisoned));
    assert_eq!(writer.finish(), Err(WriterError::Poisoned));

    let (mut writer, _) = Writer::new(Limits::default());
    writer.finish().unwrap();
    assert_eq!(writer.append(Micros(1), &frame), Err(WriterError::Finished));
}

#[test]
fn a_record_that_was_not_written_is_taken_back() {
    let (file, frames) = (recording(5, 9).unwrap(), |file| -> Vec<Vec<u8>> {
        Reader::new(file).unwrap().map(|record| record.unwrap().frame.bytes.to_vec()).collect()
    });
    let all = frames(&file);
    let (mut writer, mut again) = Writer::new(Limits::default());
    for (number, frame) in all.iter().enumerate().take(all.len() - 1) {
        if number % 3 == 1 {
            writer.append(Micros(7), frame).unwrap();
            writer.take_back();
            writer.take_back();
        }
        again.extend(writer.append(Micros(7), frame).unwrap());
        assert_eq!(writer.file_bytes(), again.len() as u64);
    }
    again.extend(writer.finish().unwrap());
    assert_eq!(Summary::scan(&again, Limits::default()).unwrap().stored_index(), StoredIndex::Agrees);
    assert_eq!(frames(&again)[..all.len() - 1], all[..all.len() - 1]);
}

#[test]
fn a_recording_without_its_scene_says_so() {
    let file = recording(3, 2).unwrap();
    let first = Summary::scan(&file, Limits::default()).unwrap().frames()[0].offset as usize;
    let cut = [&file[..FILE_HEADER_BYTES], &file[first..]].concat();
    let mut player = Player::new(&cut, Limits::default()).unwrap();
    let event = player.next_event();
    assert!(matches!(event, Some(PlayerEvent::Unusable { reason: FollowError::NoScene, .. })), "{event:?}");
    while player.next_event().is_some() {}
    assert_eq!((player.stats().applied, player.stats().unusable), (0, 3));
}

#[test]
fn the_specifications_dump_is_a_file_of_this_crate() {
    let spec = include_str!("../../../docs/spec/recording.md");
    let mut numbering = Numbering::default();
    let (mut writer, mut file) = Writer::new(Limits::default());
    // A keyframe of the empty state: the codec's header, no sections, the state hash 0.
    let mut body = [&[1u8, 1, 1, 0][..], &[0; 25]].concat();
    let crc = crc32c::crc32c(&body).to_le_bytes();
    body[24..28].copy_from_slice(&crc);
    file.extend(writer.append(Micros(0), &numbering.keyframe(&body).unwrap()).unwrap());
    let close = numbering.message(&Close::new(CloseCode::DONE, "")).unwrap();
    file.extend(writer.append(Micros(33_334), &close).unwrap());
    file.extend(writer.finish().unwrap());
    assert_eq!(crate::message::testing::dump(spec), file);
    assert_eq!(Summary::scan(&file, Limits::default()).unwrap().stored_index(), StoredIndex::Agrees);
}
