//! Budgets of rays: what waits, for how long, and where it ends.

use super::*;
use crate::points::PointId;

const LONGEST: u16 = 5;

fn rationed(rays: u64) -> ServerSettings {
    let ray_budget = Some(RayBudget { rays, longest_age: LONGEST });
    ServerSettings { ray_budget, threshold: 2, ..settings(Profile::SURFACE, 12.0) }
}

/// Steps on, looking where the camera path begins.
fn ahead(server: &mut Server, scene: &Scene, frame: u32, at: u32) -> StepOutput {
    server.step(FrameIndex(frame), time(at), &views(scene, 0), &NoClock).unwrap()
}

/// AO bytes of every point in view.
fn seen(server: &Server) -> Vec<(PointId, u8)> {
    let field = &server.trace.state.field;
    let points = field.chunks().iter().flat_map(|chunk| field.visible(chunk));
    points.map(|point| (point.id, point.ao)).collect()
}

#[test]
fn a_budget_of_rays_is_kept_but_for_a_chunk_and_nothing_starves() {
    for scene in scenes() {
        let mut free = server(&scene, ServerSettings { ray_budget: None, ..rationed(1) });
        let full: Vec<FrameStats> =
            (0..40).map(|frame| ahead(&mut free, &scene, frame, frame).stats).collect();
        assert!(full.iter().all(|stats| stats.waiting.is_none()));
        let budget = full[1..].iter().map(|stats| stats.rays).sum::<u64>() / 39 / 5;
        let mut short = server(&scene, rationed(budget));
        let (mut oldest, mut late) = (0, 0);
        let chunks = short.trace.state.field.chunks().len();
        let mut fewest = chunks;
        for frame in 0..40 {
            let stats = ahead(&mut short, &scene, frame, frame).stats;
            let scheduler = &short.trace.state.scheduler;
            fewest = fewest.min((0..chunks).filter(|&chunk| scheduler.is_chosen(chunk)).count());
            let Some(waiting) = stats.waiting else {
                assert!(stats.first && frame == 0, "only the first frame leaves nothing");
                continue;
            };
            // Chunks are traced whole, and planned with what they took the last time.
            assert!(stats.rays <= budget * 2 + 24 * 256, "{} of {budget}", stats.rays);
            assert_eq!(waiting.points == 0, waiting.oldest == 0);
            (oldest, late) = (oldest.max(waiting.oldest), waiting.points);
        }
        assert!(late > 100, "{late} wait of what takes five times the budget");
        // The bound that `RayBudget` states.
        let bound = usize::from(LONGEST) + chunks.div_ceil(fewest);
        assert!(oldest > LONGEST && usize::from(oldest) <= bound, "{oldest} of {bound}");
    }
}

#[test]
fn what_waited_is_made_good_when_the_scene_rests() {
    let scene = colonnade();
    let run = |settings| {
        let mut server = server(&scene, settings);
        let mut left = Vec::new();
        for frame in 0..200 {
            let stats = ahead(&mut server, &scene, frame, frame.min(20)).stats;
            left.push(stats.waiting.map_or(0, |waiting| waiting.points));
        }
        (server, left)
    };
    let (late, left) = run(rationed(10_000));
    assert!(left[20] > 100 && left.last() == Some(&0), "{left:?}");
    assert!(left[20..].windows(2).all(|pair| pair[1] <= pair[0]), "{left:?}");
    let (full, _) = run(ServerSettings { ray_budget: None, ..rationed(1) });
    assert_eq!(seen(&late), seen(&full));
}

#[test]
fn what_is_largest_on_the_screen_goes_first() {
    let scene = colonnade();
    let mut server = server(&scene, rationed(20_000));
    for frame in 0..2 {
        server.step(FrameIndex(frame), time(frame * 30), &views(&scene, frame), &NoClock).unwrap();
    }
    let eye = Vec3::from(views(&scene, 1)[0].eye);
    let tracing = &server.trace.state;
    let stale = tracing.field.stale(true);
    let distance =
        |chunk: &field::Chunk| tracing.field.bounds(&tracing.world, chunk).distance_squared(eye).sqrt();
    let chunks = || tracing.field.chunks().iter().enumerate();
    let mean = |of: &dyn Fn(usize) -> bool| {
        let of: Vec<f32> = chunks().filter(|(i, _)| of(*i)).map(|(_, chunk)| distance(chunk)).collect();
        assert!(!of.is_empty());
        of.iter().sum::<f32>() / of.len() as f32
    };
    let traced = mean(&|chunk| tracing.scheduler.is_chosen(chunk));
    let waiting = mean(&|chunk| stale[chunk] > 0);
    assert!(traced < waiting, "traced at {traced} m, waiting at {waiting} m");
}
