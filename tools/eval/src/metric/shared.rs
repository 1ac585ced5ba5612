//! Comparison with the figures of independent implementations. They are in the folder that `PSAO_SHARED` names, or in
//! `shared` beside the repository; without them the tests are skipped.

use psao_reconstruct::{AoImage, Size};

use super::{Comparison, Lpips, flip, ssim};

/// Returns the folder `metrics` of the shared data and its table of figures.
fn shared() -> Option<(String, serde_json::Value)> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").to_owned();
    let folder = format!("{}/metrics", std::env::var("PSAO_SHARED").unwrap_or(beside));
    let Ok(text) = std::fs::read_to_string(format!("{folder}/metrics.json")) else {
        assert!(std::env::var_os("PSAO_REQUIRE_SHARED").is_none(), "no reference figures in {folder}");
        eprintln!(
            "SKIPPED: no reference figures at {folder}/metrics.json; set PSAO_SHARED to check against them"
        );
        return None;
    };
    Some((folder, serde_json::from_str(&text).unwrap()))
}

/// Calls `check` for every grey pair with its name, its two images and its figures.
fn each_pair(mut check: impl FnMut(&str, &AoImage, &AoImage, &serde_json::Value)) {
    let Some((folder, json)) = shared() else { return };
    let mut compared = 0;
    for pair in json["pairs"].as_array().unwrap().iter().filter(|pair| pair["channels"] == 1) {
        let name = pair["name"].as_str().unwrap();
        let [reference, test] = ["ref", "test"].map(|side| {
            let grey = image::open(format!("{folder}/pairs/{name}.{side}.png")).unwrap().into_luma8();
            AoImage::from_bytes(Size::new(grey.width(), grey.height()).unwrap(), grey.as_raw()).unwrap()
        });
        check(name, &reference, &test, pair);
        compared += 1;
    }
    assert!(compared > 20, "only {compared} grey pairs in {folder}");
}

#[test]
fn errors_equal_those_of_other_implementations() {
    each_pair(|name, reference, test, pair| {
        let found = Comparison::new(reference, test).unwrap();
        // The figures were computed from bytes / 255 in f64. The images here are f32, rounded to 6e-8.
        let mae = pair["mae"].as_f64().unwrap();
        assert!((found.mae - mae).abs() < 1e-7, "{name}: mae {} against {mae}", found.mae);
        let rmse = pair["mse"].as_f64().unwrap().sqrt();
        assert!((found.rmse - rmse).abs() < 1e-7, "{name}: rmse {} against {rmse}", found.rmse);
        match pair["psnr_db"].as_f64() {
            Some(db) => assert!((found.psnr - db).abs() < 2e-4, "{name}: {} dB against {db}", found.psnr),
            None => assert_eq!(found.psnr, f64::INFINITY, "{name} is identical"),
        }
    });
}

#[test]
fn structural_similarity_equals_that_of_scikit_image() {
    each_pair(|name, reference, test, pair| {
        let (found, other) =
            (ssim::ssim(reference, test).unwrap(), pair["ssim"]["gauss11_pop"].as_f64().unwrap());
        assert!((found - other).abs() < 1e-9, "{name}: {found} against {other}");
    });
}

#[test]
fn flip_equals_the_reference_implementation() {
    each_pair(|name, reference, test, pair| {
        let (found, other) =
            (flip::flip(reference, test).unwrap(), pair["flip"]["mean_of_map_f64"].as_f64().unwrap());
        assert!((found - other).abs() < 1e-6, "{name}: {found} against {other}");
    });
}

#[test]
fn flip_maps_equal_the_reference_implementation() {
    let Some((folder, json)) = shared() else { return };
    let mut compared = 0;
    each_pair(|name, reference, test, _| {
        let Some(file) = json["flip_maps"][name].as_str() else { return };
        let file = file.split(' ').next().unwrap();
        let bytes = std::fs::read(format!("{folder}/{file}")).unwrap();
        let found = flip::flip_map(reference, test).unwrap();
        assert_eq!(found.len() * 4, bytes.len(), "{name}");
        for (pixel, (found, other)) in found.iter().zip(bytes.as_chunks().0).enumerate() {
            let other = f32::from_le_bytes(*other);
            assert!((found - other).abs() <= 1e-6, "{name}, pixel {pixel}: {found} against {other}");
        }
        compared += 1;
    });
    assert!(compared > 1, "only {compared} maps of grey pairs in {folder}");
}

#[test]
fn lpips_equals_the_authors_implementation() {
    let Some((folder, json)) = shared() else { return };
    let weights = std::fs::read(format!("{folder}/lpips_alex_v0_1.f16")).unwrap();
    let network = Lpips::from_weights(&weights).unwrap();
    let tolerance = json["tolerances"]["lpips_f16_weights"].as_f64().unwrap();
    each_pair(|name, reference, test, pair| {
        let (found, other) =
            (network.distance(reference, test).unwrap(), pair["lpips"]["alex_v0_1"].as_f64().unwrap());
        assert!((found - other).abs() < tolerance, "{name}: {found} against {other}");
    });
}
