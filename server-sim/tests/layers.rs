//! The layers of the crate: no folder imports one above it, and the files of a folder do not import each other in a
//! circle.

#![expect(clippy::unwrap_used, reason = "this is a test, its helpers included")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Folders of `src`, the lowest first. Each may import those before it.
const LAYERS: [&str; 6] = ["scene", "bvh", "world", "points", "ao", "server"];

/// Lower layers that a layer must not import either: the trees know boxes and triangles, not scenes.
const APART: [(&str, &str); 1] = [("bvh", "scene")];

/// Folder whose files are checked for imports upwards only.
const WITHOUT_CIRCLE_CHECK: [&str; 1] = ["server"];

/// The imports between the children of each folder.
type Graph = BTreeMap<PathBuf, BTreeMap<String, BTreeSet<String>>>;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Returns the path of a file's module from the root of the crate.
fn module_of(root: &Path, file: &Path) -> Vec<String> {
    let relative = file.strip_prefix(root).unwrap().with_extension("");
    let parts = relative.iter().map(|part| part.to_str().unwrap().to_owned());
    parts.filter(|part| part != "mod" && part != "lib").collect()
}

/// Returns whether a file has only tests.
fn is_test(module: &[String]) -> bool {
    module.iter().any(|part| part == "tests")
}

/// Returns the code of a file without comments and without the test modules at its end.
fn code(file: &Path) -> String {
    let text = fs::read_to_string(file).unwrap();
    let lines: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap()).collect();
    let is_tests =
        |pair: &[&str]| pair[0] == "#[cfg(test)]" && pair[1].contains("mod ") && pair[1].ends_with('{');
    let end = lines.windows(2).position(is_tests).unwrap_or(lines.len());
    lines[..end].join("\n")
}

/// Returns the paths that follow `start` in a text. A braced list gives one path per item.
fn paths(text: &str, start: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices(start) {
        let before = text[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &text[at + start.len()..];
        let (first, after) = split_path(rest);
        let first = names(first);
        if let Some(list) = after.strip_prefix('{') {
            let items =
                list.split('}').next().unwrap().split(',').map(|item| names(split_path(item.trim()).0));
            let items = items.filter(|item| !item.is_empty());
            found.extend(items.map(|item| [first.clone(), item].concat()));
        } else {
            found.push(first);
        }
    }
    found.retain(|path| !path.is_empty());
    found
}

/// Splits a text after its leading path.
fn split_path(text: &str) -> (&str, &str) {
    let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
    text.split_at(end.unwrap_or(text.len()))
}

/// Returns the names of a path such as `a::b::C`, without `self`.
fn names(path: &str) -> Vec<String> {
    path.split("::").filter(|name| !name.is_empty() && *name != "self").map(str::to_owned).collect()
}

/// Returns everything that a file imports, as paths from the root of the crate.
fn imports(module: &[String], is_folder: bool, text: &str) -> Vec<Vec<String>> {
    let parent = if is_folder { module } else { &module[..module.len().saturating_sub(1)] };
    let grandparent = &parent[..parent.len().saturating_sub(1)];
    let here = |base: &[String], path: Vec<String>| [base, &path].concat();
    let mut all = paths(text, "crate::");
    let up = if is_folder { grandparent } else { parent };
    all.extend(
        paths(text, "super::").into_iter().filter(|path| path[0] != "super").map(|path| here(up, path)),
    );
    if !is_folder {
        all.extend(paths(text, "super::super::").into_iter().map(|path| here(grandparent, path)));
    }
    all
}

/// Returns, for each folder, the file or folder of each re-exported name.
fn reexports(root: &Path, files: &[PathBuf]) -> BTreeMap<(Vec<String>, String), String> {
    let mut found = BTreeMap::new();
    for file in files.iter().filter(|file| file.ends_with("mod.rs")) {
        let folder = module_of(root, file);
        let text = code(file);
        for line in text.split(';') {
            let Some((_, path)) = line.split_once("use ").filter(|(before, _)| before.contains("pub")) else {
                continue;
            };
            let Some((child, items)) = path.split_once("::") else { continue };
            for item in items.trim_matches(['{', '}', ' ', '\n']).split(',') {
                let name = item.trim().rsplit("::").next().unwrap().to_owned();
                found.insert((folder.clone(), name), child.trim().to_owned());
            }
        }
    }
    found
}

/// Returns a circle of a graph, if there is one.
fn circle(graph: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    let mut left = graph.clone();
    loop {
        let nodes: BTreeSet<String> = left.keys().cloned().collect();
        // A node without imports from the remaining nodes is in no circle.
        left.retain(|_, to| to.iter().any(|node| nodes.contains(node)));
        if left.is_empty() {
            return None;
        }
        if left.len() == nodes.len() {
            return Some(nodes.into_iter().collect());
        }
    }
}

#[test]
fn no_layer_imports_one_above_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let layer = |name: &String| LAYERS.iter().position(|layer| layer == name);
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut checked = 0;
    for file in &files {
        let module = module_of(&root, file);
        let Some(own) = module.first().and_then(layer).filter(|_| !is_test(&module)) else { continue };
        for path in imports(&module, file.ends_with("mod.rs"), &code(file)) {
            let Some(other) = layer(&path[0]) else { continue };
            let shown = file.strip_prefix(&root).unwrap().display();
            assert!(
                other <= own,
                "{shown} imports crate::{}: {} is above it",
                path.join("::"),
                LAYERS[other]
            );
            let apart = APART.contains(&(LAYERS[own], LAYERS[other]));
            assert!(
                !apart,
                "{shown} imports crate::{}: {} must not know of it",
                path.join("::"),
                LAYERS[own]
            );
            checked += 1;
        }
    }
    assert!(checked > 200, "only {checked} imports were found");
}

#[test]
fn files_of_a_folder_do_not_import_each_other_in_a_circle() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let names = reexports(&root, &files);
    let mut graphs = Graph::new();
    for file in &files {
        let module = module_of(&root, file);
        let is_folder = file.ends_with("mod.rs");
        if module.is_empty() || is_test(&module) || WITHOUT_CIRCLE_CHECK.contains(&module[0].as_str()) {
            continue;
        }
        for mut path in imports(&module, is_folder, &code(file)) {
            let depth = module.iter().zip(&path).take_while(|(a, b)| a == b).count();
            let (Some(from), true) = (module.get(depth), path.len() > depth) else { continue };
            // A name that the folder re-exports stands for the file of its origin.
            if let Some(child) = names.get(&(path[..depth].to_vec(), path[depth].clone())) {
                path[depth].clone_from(child);
            }
            if path[depth] != *from {
                let folder = module[..depth].iter().collect();
                let graph = graphs.entry(folder).or_default();
                graph.entry(from.clone()).or_default().insert(path[depth].clone());
            }
        }
    }
    assert!(graphs.len() >= 6, "too few folders: {:?}", graphs.keys());
    for (folder, graph) in &graphs {
        let found = circle(graph).map(|nodes| nodes.join(", "));
        assert_eq!(found, None, "a circle of files in src/{}", folder.display());
    }
}

#[test]
fn circles_are_found_and_trees_are_not() {
    let graph = |edges: &[(&str, &str)]| {
        let mut graph = BTreeMap::<String, BTreeSet<String>>::new();
        for (from, to) in edges {
            graph.entry((*from).to_owned()).or_default().insert((*to).to_owned());
        }
        graph
    };
    assert_eq!(circle(&graph(&[("a", "b"), ("b", "c"), ("a", "c")])), None);
    assert_eq!(circle(&graph(&[("a", "b"), ("b", "c"), ("c", "b")])).unwrap().len(), 3);
    let text = "use crate::bvh::{Blas, Tlas};\nuse super::ids;\nlet x = crate::scene::Scene::load(a);";
    let module = ["world".to_owned(), "build".to_owned()];
    let found = imports(&module, false, text).into_iter().map(|path| path.join("::"));
    assert_eq!(found.collect::<Vec<_>>(), ["bvh::Blas", "bvh::Tlas", "scene::Scene::load", "world::ids"]);
}
