//! The scene table as a whole: what both ends know before the first keyframe.

use std::sync::Arc;

use psao_codec::cells::{Grid, GridError, InstanceLayout, Layout, LayoutError};

use crate::Limits;
use crate::message::{InstanceBatch, InstanceEntry, MAX_BATCH, Message, MessageError, Scene, SceneInfo};

/// Why SCENE messages do not make a scene table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Instances came before the stream was described, or it was described twice.
    #[error("SCENE frames are out of order: expected {expected}")]
    Order {
        /// What should have come.
        expected: &'static str,
    },
    /// A batch does not follow the one before it.
    #[error("SCENE frames are out of order: instances from {found} on, expected those from {expected} on")]
    Batch {
        /// Instances that came before.
        expected: u32,
        /// Index of the batch's first.
        found: u32,
    },
    /// The number of instances is not the announced one, or over the limit.
    #[error("the scene has {found} instances, expected at most {expected}")]
    Instances {
        /// Announced or allowed.
        expected: u32,
        /// Found.
        found: u64,
    },
    /// The points of the instances do not add up.
    #[error("the instances have {found} points in all, {expected} were announced")]
    Points {
        /// Announced.
        expected: u32,
        /// Sum of the instances.
        found: u64,
    },
    /// The grid of an instance makes no sense.
    #[error("instance {instance}: {source}")]
    Grid {
        /// Index of the instance.
        instance: u32,
        /// What is wrong.
        source: GridError,
    },
    /// The instances do not make a layout, or one over the limits.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// A message is bad in itself.
    #[error(transparent)]
    Message(#[from] MessageError),
}

/// A checked scene table and the codec's layout made from it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneTable {
    info: SceneInfo,
    instances: Vec<InstanceEntry>,
    layout: Arc<Layout>,
}

impl SceneTable {
    /// Checks a scene and works out its layout.
    ///
    /// # Errors
    /// [`SceneError`] when counts, grids or buckets do not fit each other or `limits`.
    pub fn new(info: SceneInfo, instances: Vec<InstanceEntry>, limits: &Limits) -> Result<Self, SceneError> {
        let found = instances.len() as u64;
        if found != u64::from(info.instance_count) {
            return Err(SceneError::Instances { expected: info.instance_count, found });
        }
        let points: u64 = instances.iter().map(|entry| u64::from(entry.points)).sum();
        if points != u64::from(info.point_count) {
            return Err(SceneError::Points { expected: info.point_count, found: points });
        }
        let grid = |(instance, entry): (u32, &InstanceEntry)| {
            let grid = Grid::new(entry.origin, entry.edge, entry.dims)
                .map_err(|source| SceneError::Grid { instance, source })?;
            let &InstanceEntry { first_bucket, bucket_count, kernel_radius, .. } = entry;
            Ok(InstanceLayout { grid, first_bucket, bucket_count, kernel_radius })
        };
        let layouts = (0u32..).zip(&instances).map(grid).collect::<Result<Vec<_>, SceneError>>()?;
        let layout = Arc::new(Layout::new(layouts, info.cell_capacity, &limits.codec)?);
        Ok(Self { info, instances, layout })
    }

    /// The stream as a whole.
    #[must_use]
    pub const fn info(&self) -> &SceneInfo {
        &self.info
    }

    /// The instances, in the order of their indices.
    #[must_use]
    pub fn instances(&self) -> &[InstanceEntry] {
        &self.instances
    }

    /// The layout of the stream's state.
    #[must_use]
    pub const fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// The payloads of the SCENE frames that carry this table, in order.
    ///
    /// # Errors
    /// [`MessageError::Invalid`] when a value makes no sense.
    pub fn payloads(&self) -> Result<Vec<Vec<u8>>, MessageError> {
        let mut payloads = vec![Scene::Info(self.info.clone()).to_payload()?];
        let mut first = 0u32;
        for entries in self.instances.chunks(MAX_BATCH) {
            let batch = InstanceBatch { first, entries: entries.to_vec() };
            payloads.push(Scene::Instances(batch).to_payload()?);
            first += entries.len() as u32;
        }
        Ok(payloads)
    }
}

/// Puts a scene table together from SCENE messages.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneAssembler {
    info: Option<SceneInfo>,
    instances: Vec<InstanceEntry>,
}

impl SceneAssembler {
    /// Takes the next message, from the start again when it does not fit what came before: in a recording an earlier
    /// table may have been cut short by damage.
    pub(crate) fn push_or_restart(
        &mut self,
        scene: Scene,
        limits: &Limits,
    ) -> Result<Option<SceneTable>, SceneError> {
        if matches!(scene, Scene::Info(_)) {
            *self = Self::default();
        }
        self.push(scene, limits)
    }

    /// Takes the next message; gives the table once it is whole.
    pub(crate) fn push(&mut self, scene: Scene, limits: &Limits) -> Result<Option<SceneTable>, SceneError> {
        match (scene, &self.info) {
            (Scene::Info(info), None) => {
                let (expected, found) = (limits.codec.max_instances, info.instance_count);
                if found > expected {
                    return Err(SceneError::Instances { expected, found: found.into() });
                }
                self.info = Some(info);
            }
            (Scene::Info(_), Some(_)) => return Err(SceneError::Order { expected: "instances" }),
            (Scene::Instances(_), None) => return Err(SceneError::Order { expected: "the scene's info" }),
            (Scene::Instances(batch), Some(info)) => {
                let expected = self.instances.len() as u32;
                if batch.first != expected {
                    return Err(SceneError::Batch { expected, found: batch.first });
                }
                let found = self.instances.len() as u64 + batch.entries.len() as u64;
                let expected = info.instance_count;
                if found > u64::from(expected) {
                    return Err(SceneError::Instances { expected, found });
                }
                self.instances.extend(batch.entries);
            }
        }
        match self.info.take_if(|info| info.instance_count as usize == self.instances.len()) {
            Some(info) => SceneTable::new(info, std::mem::take(&mut self.instances), limits).map(Some),
            None => Ok(None),
        }
    }
}
