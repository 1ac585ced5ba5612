//! A queue of future events.

use std::collections::BTreeMap;

use psao_proto::Micros;

/// Events in order of time. Events of the same time stay in the order in which they were added.
#[derive(Clone, Debug)]
pub(crate) struct Queue<T> {
    events: BTreeMap<(Micros, u64), T>,
    number: u64,
}

impl<T> Default for Queue<T> {
    fn default() -> Self {
        Self { events: BTreeMap::new(), number: 0 }
    }
}

impl<T> Queue<T> {
    pub(crate) fn push(&mut self, at: Micros, event: T) {
        self.events.insert((at, self.number), event);
        self.number += 1;
    }

    /// Returns the next event with its time, if that is not after `now`.
    pub(crate) fn pop(&mut self, now: Micros) -> Option<(Micros, T)> {
        let entry = self.events.first_entry().filter(|entry| entry.key().0 <= now)?;
        let ((at, _), event) = entry.remove_entry();
        Some((at, event))
    }

    /// Returns the time of the next event.
    pub(crate) fn next_event_time(&self) -> Option<Micros> {
        self.events.first_key_value().map(|((at, _), _)| *at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_by_time_then_by_order() {
        let mut queue = Queue::default();
        for (at, event) in [(5, 'c'), (3, 'a'), (5, 'd'), (3, 'b'), (9, 'e')] {
            queue.push(Micros(at), event);
        }
        assert_eq!((queue.pop(Micros(2)), queue.next_event_time()), (None, Some(Micros(3))));
        let all: String = std::iter::from_fn(|| queue.pop(Micros(8))).map(|(_, event)| event).collect();
        assert_eq!((all.as_str(), queue.next_event_time()), ("abcd", Some(Micros(9))));
    }
}
