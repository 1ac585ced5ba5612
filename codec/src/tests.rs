//! Tests of the types that serve both profiles.

use std::sync::Arc;

use super::*;
use crate::block::BlockCoder;
use crate::envelope::{FrameError, FrameKind, Profile};
use crate::testing::{layout, meta, sample, story};

fn surface_layout() -> Layout {
    let layout = surface::Layout::new(Vec::new(), Vec::new(), &Limits::default()).unwrap();
    Layout::Surface(Arc::new(layout))
}

#[test]
fn a_paper_stream_is_followed_as_by_the_paper_decoder() {
    let story = story(BlockCoder::default());
    let mut state = State::new(&Layout::Paper(Arc::clone(story.empty.layout())));
    let mut decoder = Decoder::new();
    for (frame, after) in [(&story.key, &story.after_key), (&story.delta, &story.after_delta)] {
        let info = decoder.decode(&mut state, &frame.body, &Limits::default()).unwrap();
        assert_eq!((&info, state.as_paper()), (&frame.info, Some(after)));
        assert_eq!((state.hash(), state.full_hash()), (after.hash(), after.full_hash()));
        assert_eq!(state.frame(), after.frame());
    }
    let meta = meta(FrameKind::Key, 4);
    let body = keyframe(&state, meta, BlockCoder::default(), &[]).unwrap();
    let mut late = State::new(&state.layout());
    apply(&mut late, &body, &Limits::default()).unwrap();
    assert_eq!(late, state);
}

#[test]
fn a_body_of_the_other_profile_is_refused_by_name() {
    let story = story(BlockCoder::Stored);
    let mut state = State::new(&surface_layout());
    let before = state.clone();
    let (offset, found, expected) = (0, Profile::PAPER, Profile::SURFACE);
    let refused = apply(&mut state, &story.key.body, &Limits::default());
    assert_eq!(refused, Err(FrameError::ProfileOther { offset, found, expected }));
    assert_eq!(state, before);
    let meta = meta(FrameKind::Key, 4);
    let body = keyframe(&state, meta, BlockCoder::Stored, &[]).unwrap();
    let mut state = State::Paper(story.empty.clone());
    let refused = apply(&mut state, &body, &Limits::default());
    assert_eq!(refused, Err(FrameError::ProfileOther { offset, found: expected, expected: found }));
    assert_eq!(state.as_paper(), Some(&story.empty));
}

#[test]
fn a_paper_stream_is_never_patched() {
    let story = story(BlockCoder::Stored);
    let (key, delta) = (State::Paper(story.after_key), State::Paper(story.after_delta));
    let mut log = ChangeLog::new(&key);
    log.record(&delta);
    let base = key.frame().unwrap();
    let meta = meta(FrameKind::Delta, 4);
    assert_eq!(patch(&delta, &log, base, meta, BlockCoder::Stored, true), Ok(None));
    let borrowed = StateRef::from(&delta);
    assert_eq!((borrowed.hash(), borrowed.frame()), (delta.hash(), delta.frame()));
}

#[test]
fn layouts_and_states_know_their_profile() {
    let (cells, surface) = (Layout::Paper(layout()), surface_layout());
    assert_eq!((cells.profile(), cells.instances()), (Profile::PAPER, 2));
    assert_eq!((surface.profile(), surface.instances()), (Profile::SURFACE, 0));
    for layout in [cells, surface] {
        let mut state = State::new(&layout);
        assert_eq!((state.layout(), state.profile()), (layout.clone(), layout.profile()));
        assert_eq!(state.as_paper().is_some(), layout.as_paper().is_some());
        assert_eq!(state.as_surface().is_some(), layout.as_surface().is_some());
        assert_eq!(state.as_surface_mut().is_some(), state.as_paper().is_none());
        assert_eq!((state.hash(), state.frame()), (StateHash::default(), None));
    }
}

#[test]
fn the_encoder_resends_by_the_threshold() {
    let made = || paper::Encoder::new(layout(), &[2, 2]).unwrap();
    let mut plain = made();
    let mut encoder = Encoder::Paper(Box::new(made().with_threshold(8, &[false, true])));
    assert!(encoder.needs_places() && !encoder.needs_weights());
    let at = |x: f32, ao| sample([x, 0.1, 0.1], ao);
    // The order of the calls is not that of the ids.
    for (point, now) in [(3, at(0.9, 10)), (0, at(0.1, 100)), (2, at(0.6, 50))] {
        assert_eq!(encoder.set_point(point, &now, 8), Ok(true));
    }
    for (point, sample) in [(0, at(0.1, 100)), (2, at(0.6, 50)), (3, at(0.9, 10))] {
        plain.put(point, &sample).unwrap();
    }
    let key = |frame| meta(FrameKind::Key, frame);
    let coder = BlockCoder::Stored;
    assert_eq!(encoder.finish(key(0), coder), plain.finish(key(0), coder));
    // Too little of AO; enough of AO; a move of what deforms.
    let next = [(0, at(0.1, 107)), (2, at(0.6, 58)), (3, at(0.6, 10))];
    let due: Vec<bool> =
        next.iter().map(|(point, sample)| encoder.set_point(*point, sample, 8).unwrap()).collect();
    assert_eq!(due, [false, true, true]);
    next[1..].iter().for_each(|(point, sample)| assert!(plain.put(*point, sample).is_ok()));
    plain.retry_unplaced();
    let delta = meta(FrameKind::Delta, 1);
    assert_eq!(encoder.finish(delta, coder), plain.finish(delta, coder));
    let (sent, place) = encoder.as_paper().map(|paper| (paper.sent_ao(2), paper.sent_place(3))).unwrap();
    assert_eq!((sent, place), (Some(58), Some(([0.6, 0.1, 0.1], [0.0, 1.0, 0.0]))));
    let unknown = encoder.set_point(4, &at(0.0, 0), 8);
    assert_eq!(unknown, Err(paper::PointError::Unknown { point: 4, count: 4 }));
}
