//! Ids of the things in a scene: positions in the scene's own tables, in file order.

/// Declares an id that is a position in one table of the scene.
macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// Returns the id of the `index`-th entry. Tables are limited to far fewer than `u32::MAX` entries.
            #[must_use]
            pub(crate) fn at(index: usize) -> Self {
                Self(u32::try_from(index).unwrap_or(u32::MAX))
            }

            /// Returns the position in the table.
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }
    };
}

id! {
    /// Id of an instance: one primitive at one node ([`Scene::instances`](crate::scene::Scene::instances)).
    InstanceId
}
id! {
    /// Id of a mesh: one primitive as modelled ([`Scene::meshes`](crate::scene::Scene::meshes)).
    MeshId
}
id! {
    /// Id of a material ([`Scene::materials`](crate::scene::Scene::materials)).
    MaterialId
}
id! {
    /// Id of a mesh at rest in metric local space ([`Scene::rests`](crate::scene::Scene::rests)).
    RestId
}
