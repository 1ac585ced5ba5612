//! `psao lab rays`: figures, dumps, and what is wrong on the command line.

use serde_json::Value;

use super::{fine, psao};

const RAYS: [&str; 13] = [
    "lab",
    "rays",
    "--scene",
    "colonnade",
    "--points",
    "1",
    "--sample",
    "40",
    "--rays",
    "24",
    "--rounds",
    "2",
    "--no-cache",
];

#[test]
fn rays_are_traced_both_ways_and_hit_the_same_whatever_the_instructions() {
    for occlusion in ["binary", "obscurance"] {
        let with = |more: &[&str]| {
            let arguments = [&RAYS[..], &["--occlusion", occlusion, "--json"], more].concat();
            serde_json::from_str::<Value>(&fine(&arguments)).unwrap()
        };
        let report = with(&[]);
        assert_eq!((&report["schema"], &report["points"]), (&"psao-bench-rays/1".into(), &40.into()));
        assert_eq!((&report["rays"], &report["occlusion"]), (&(40 * 24).into(), &occlusion.into()));
        let hits = report["bundles"]["hits"].as_u64().unwrap();
        assert!(hits > 50 && hits < 900, "{report}");
        // A ray that grazes an edge may fall either way.
        assert!(report["differing"].as_u64().unwrap() <= 2, "{report}");
        for way in ["bundles", "twin"] {
            let rates = &report[way]["rays_a_second"];
            let [least, median, most] =
                ["least", "median", "most"].map(|figure| rates[figure].as_f64().unwrap());
            assert!(0.0 < least && least <= median && median <= most);
        }
        let names = psao(&[&RAYS[..], &["--instructions", "none"]].concat());
        assert_eq!(names.code, Some(3));
        let (_, names) = names.err.split_once("there are ").unwrap();
        for name in names.trim().split(", ") {
            let other = with(&["--instructions", name]);
            assert_eq!(other["bundles"]["hits"], hits, "{name}");
            assert!(other["instructions"].as_str().unwrap().eq_ignore_ascii_case(name));
        }
    }
    assert!(fine(&RAYS).contains("The server's tracer over the plain tree: "));
}

#[test]
fn a_dump_has_the_triangles_and_the_rays() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rays.bin");
    let report = fine(&[&RAYS[..], &["--json", "--dump", file.to_str().unwrap()]].concat());
    let report: Value = serde_json::from_str(&report).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[4 * at..4 * at + 4].try_into().unwrap());
    let (triangles, rays) = (word(1), word(2));
    assert_eq!((&report["triangles"], &report["rays"]), (&triangles.into(), &rays.into()));
    assert_eq!(word(0), 3 * triangles);
    assert_eq!(bytes.len(), 12 + 36 * triangles as usize + 12 * triangles as usize + 28 * rays as usize);
    let ray: Vec<f32> = (bytes.len() / 4 - 7..bytes.len() / 4).map(|at| f32::from_bits(word(at))).collect();
    let length = ray[3..6].iter().map(|axis| axis * axis).sum::<f32>();
    assert!((length - 1.0).abs() < 1e-5 && report["radius_m"].as_f64().unwrap() as f32 == ray[6]);
    let nowhere = folder.path().join("no/such/folder");
    assert_eq!(psao(&[&RAYS[..], &["--dump", nowhere.to_str().unwrap()]].concat()).code, Some(1));
}
