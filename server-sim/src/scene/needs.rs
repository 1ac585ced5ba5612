//! What a scene needs from a codec and a client: everything else can be left out.

pub use psao_proto::message::Needs;

/// The needs of a scene: per instance, and of all of them together.
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

    /// Needs of each instance, in the order of the scene's instances.
    #[must_use]
    pub fn instances(&self) -> &[Needs] {
        &self.instances
    }

    /// What any instance needs.
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
