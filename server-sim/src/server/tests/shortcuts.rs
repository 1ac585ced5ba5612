//! What a server leaves out changes no byte.

use super::edits::{edited, first};
use super::*;
use crate::shortcuts::Shortcuts;

/// All shortcuts but one, each in turn; then none.
fn fewer() -> impl Iterator<Item = Shortcuts> {
    Shortcuts::EACH.into_iter().map(|one| Shortcuts::ALL - one).chain([Shortcuts::NONE])
}

/// Frame bodies of a run with these shortcuts, and rays after the first frame.
type Run<'a> = &'a dyn Fn(Shortcuts) -> (Vec<Vec<u8>>, u64);

/// Runs with all shortcuts and with fewer, whose frames must be the same; rays with all and with none.
fn compare(what: &str, run: Run<'_>, fewer: impl Iterator<Item = Shortcuts>) -> [u64; 2] {
    let (lazy, fewest) = run(Shortcuts::ALL);
    let mut most = 0;
    for shortcuts in fewer {
        let (bodies, rays) = run(shortcuts);
        let first = lazy.iter().zip(&bodies).position(|(a, b)| a != b);
        assert_eq!((first, lazy.len()), (None, bodies.len()), "{what}: {shortcuts:?}");
        most = rays;
    }
    [fewest, most]
}

/// Takes notes of a run.
fn note(run: &mut (Vec<Vec<u8>>, u64), output: &StepOutput) {
    run.1 += if output.stats.first { 0 } else { output.stats.rays };
    run.0.push(output.body.clone());
}

#[test]
fn leaving_less_out_gives_the_same_bytes() {
    for (turn, (scene, profile)) in scenes_by_profile().enumerate() {
        let mut lazy = settings(profile, 2.0);
        lazy.ao.kind = if turn < 2 { Occlusion::Obscurance } else { Occlusion::Binary };
        lazy.threshold = 2;
        let run = |shortcuts| {
            let mut run = Default::default();
            clip(&scene, ServerSettings { shortcuts, ..lazy }, 12, |_, output| note(&mut run, output));
            run
        };
        let rays = compare(&format!("{} {profile}", scene.name()), &run, fewer());
        assert!(rays[0] * 2 < rays[1], "the shortcuts save rays: {rays:?}");
    }
}

#[test]
fn leaving_less_out_gives_the_same_bytes_when_the_scene_is_edited() {
    let mut motions = [0; 3];
    for (scene, profile) in scenes_by_profile() {
        let has = |motion| usize::from(first(&scene, motion).is_some());
        motions = [Motion::Static, Motion::Rigid, Motion::Deforming].map(has).map(|has| has + motions[0]);
        let lazy = ServerSettings { threshold: 2, ..settings(profile, 2.0) };
        let run = |shortcuts| {
            let mut run = Default::default();
            edited(&scene, ServerSettings { shortcuts, ..lazy }, |_, output| note(&mut run, output));
            run
        };
        let rays = compare(&format!("{} {profile}", scene.name()), &run, fewer());
        assert!(rays[0] * 4 < rays[1] * 3, "the shortcuts save rays: {rays:?}");
    }
    assert!(motions.iter().all(|&count| count > 0), "{motions:?}");
}

/// A floor, and a lid over it that an animation shows from 0.5 s to 1 s of each second and a half.
fn blinking() -> Arc<Scene> {
    let mut doc = crate::scene::tests::Doc::default();
    let square = |y: f32, half: f32| {
        [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]].map(|[x, z]| [x * half, y, z * half])
    };
    let (floor, lid) = (doc.vectors(&square(0.0, 2.0)), doc.vectors(&square(0.2, 0.5)));
    let corners = doc.indices(&[0, 1, 2, 0, 2, 3]);
    let (times, shown) = (doc.scalars(&[0.0, 0.5, 1.0, 1.5]), doc.scalars(&[0.0, 1.0, 0.0, 0.0]));
    let primitive = |positions| {
        format!(r#"{{"primitives":[{{"attributes":{{"POSITION":{positions}}},"indices":{corners}}}]}}"#)
    };
    let scene = doc.load(&format!(
        r#""nodes":[{{"mesh":0}},{{"mesh":1}}],"meshes":[{},{}],"animations":[{{"samplers":[{{"input":{times},"output":{shown}}}],
        "channels":[{{"sampler":0,"target":{{"path":"pointer","extensions":{{"KHR_animation_pointer":{{
        "pointer":"/nodes/1/extensions/KHR_node_visibility/visible"}}}}}}}}]}}]"#,
        primitive(floor),
        primitive(lid),
    ));
    Arc::new(scene.unwrap())
}

#[test]
fn leaving_less_out_gives_the_same_bytes_while_a_thing_comes_and_goes() {
    let scene = blinking();
    for profile in PROFILES {
        let of = settings(profile, 40.0);
        let lazy = ServerSettings { threshold: 1, ao: AoSettings { rays: 32, ..of.ao }, ..of };
        let mut darkest = Vec::new();
        let run = |shortcuts| {
            let mut run = Default::default();
            clip(&scene, ServerSettings { shortcuts, ..lazy }, 24, |_, output| note(&mut run, output));
            run
        };
        compare(&format!("a thing that comes and goes, {profile}"), &run, fewer());
        let mut everywhere = server(&scene, lazy);
        for frame in 0..24 {
            everywhere.step(FrameIndex(frame), time(frame), &[], &NoClock).unwrap();
            let field = &everywhere.trace.state.field;
            let floor = field.chunks().iter().filter(|chunk| chunk.instance == 0);
            darkest.extend(floor.flat_map(|chunk| field.visible(chunk)).map(|point| point.ao).min());
        }
        assert_eq!(darkest.len(), 24);
        // The floor is bright without the lid, at the start as well as after it, and dark below it.
        let [bright, dark] = [darkest.iter().max().unwrap(), darkest.iter().min().unwrap()];
        assert!(*bright == 255 && *dark < 200, "{profile}: {darkest:?}");
        assert_eq!(darkest[0], 255, "{profile}: {darkest:?}");
        assert!(darkest.windows(2).any(|pair| pair[0] < 200 && pair[1] == 255), "{profile}: {darkest:?}");
    }
}

/// The clip as a whole, in a few steps, along the camera path, all around and nowhere in turns.
fn whole_clip(scene: &Arc<Scene>) {
    const STEPS: u32 = 18;
    let points = PointSettings { per_m2: 0.2, minimum: 4, seed: 3 };
    let of = settings(Profile::SURFACE, 1.0);
    // Which points cameras see depends on no shortcut; the tests above look.
    let (threshold, unseen_threshold) = (1, Some(1));
    let base =
        ServerSettings { points, threshold, unseen_threshold, ao: AoSettings { rays: 8, ..of.ao }, ..of };
    let run = |shortcuts| {
        let mut server = server(scene, ServerSettings { shortcuts, ..base });
        let mut run = Default::default();
        for frame in 0..STEPS {
            let time_s = scene.duration_s() * f64::from(frame) / f64::from(STEPS);
            let views = match views(scene, frame).as_slice() {
                [own] if frame % 6 < 4 => vec![CameraPose { aspect: own.aspect, ..scene.camera(time_s) }],
                others => others.to_vec(),
            };
            let time = StreamTime((time_s * 1e6) as u64);
            note(&mut run, &server.step(FrameIndex(frame), time, &views, &NoClock).unwrap());
        }
        run
    };
    compare(scene.name(), &run, [Shortcuts::NONE].into_iter());
}

#[test]
fn whole_clips_of_all_scenes_are_the_same_without_shortcuts() {
    let files = crate::scene::tests::shared_files();
    let files = files.iter().map(|file| file.to_str().unwrap());
    for name in Scene::builtin_names().iter().copied().chain(files) {
        whole_clip(&Arc::new(Scene::load(name).unwrap()));
    }
}
