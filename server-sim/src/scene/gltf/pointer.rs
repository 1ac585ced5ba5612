//! JSON pointers of `KHR_animation_pointer`, as far as they lead to something that a surface depends on.

use crate::scene::animation::Property;

/// Target of a pointer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Target {
    /// A property of a node.
    Node { node: usize, property: Property },
    /// One morph weight of a node.
    NodeWeight { node: usize, weight: usize },
    /// The default morph weights of a mesh: all, or one of them.
    MeshWeights { mesh: usize, weight: Option<usize> },
}

/// Returns the target of a pointer, or `None` if no surface depends on it.
pub(super) fn parse(pointer: &str) -> Option<Target> {
    let parts: Vec<&str> = pointer.strip_prefix('/')?.split('/').collect();
    let index = |text: &str| text.parse::<usize>().ok();
    match *parts.as_slice() {
        ["nodes", node, name] => {
            let property = match name {
                "translation" => Property::Translation,
                "rotation" => Property::Rotation,
                "scale" => Property::Scale,
                "weights" => Property::Weights,
                _ => return None,
            };
            Some(Target::Node { node: index(node)?, property })
        }
        ["nodes", node, "extensions", "KHR_node_visibility", "visible"] => {
            Some(Target::Node { node: index(node)?, property: Property::Visibility })
        }
        ["nodes", node, "weights", weight] => {
            Some(Target::NodeWeight { node: index(node)?, weight: index(weight)? })
        }
        ["meshes", mesh, "weights"] => Some(Target::MeshWeights { mesh: index(mesh)?, weight: None }),
        ["meshes", mesh, "weights", weight] => {
            Some(Target::MeshWeights { mesh: index(mesh)?, weight: Some(index(weight)?) })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_surfaces_depend_on_is_a_target() {
        let node = |node, property| Some(Target::Node { node, property });
        assert_eq!(parse("/nodes/3/rotation"), node(3, Property::Rotation));
        assert_eq!(parse("/nodes/0/extensions/KHR_node_visibility/visible"), node(0, Property::Visibility));
        assert_eq!(parse("/nodes/1/weights/2"), Some(Target::NodeWeight { node: 1, weight: 2 }));
        assert_eq!(parse("/meshes/4/weights"), Some(Target::MeshWeights { mesh: 4, weight: None }));
        for other in [
            "",
            "/",
            "nodes/0/scale",
            "/nodes/-1/scale",
            "/nodes/0",
            "/nodes/0/weights/x",
            "/nodes/0/extensions/KHR_node_hoverability/hoverable",
            "/materials/0/alphaCutoff",
            "/cameras/0/perspective/yfov",
        ] {
            assert_eq!(parse(other), None, "{other}");
        }
    }
}
