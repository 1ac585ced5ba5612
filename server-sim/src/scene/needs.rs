//! The features that a scene requires of a codec and a client.

pub use psao_proto::message::Needs;

/// The features that a scene requires, per instance and as a union.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneNeeds {
    instances: Vec<Needs>,
    all: Needs,
}

impl SceneNeeds {
    pub(crate) fn new(instances: Vec<Needs>) -> Self {
        let all = instances.iter().fold(Needs::NONE, |sum, needs| sum | *needs);
        Self { instances, all }
    }

    /// Returns the features that each instance requires, in the order of the scene's instances.
    #[must_use]
    pub fn instances(&self) -> &[Needs] {
        &self.instances
    }

    /// Returns the union over all instances.
    #[must_use]
    pub fn all(&self) -> Needs {
        self.all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn union_holds_what_any_instance_needs() {
        let needs = SceneNeeds::new(vec![Needs::SKIN, Needs::MASKED | Needs::DOUBLE_SIDED, Needs::NONE]);
        assert_eq!(needs.all().bits(), 0b11_0001);
        assert!(needs.all().contains(Needs::SKIN | Needs::MASKED));
        assert!(!needs.all().contains(Needs::MORPH));
        assert_eq!(needs.all().names().collect::<Vec<_>>(), ["skin", "mask", "double-sided"]);
    }
}
