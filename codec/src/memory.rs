//! Memory, counted from the sizes of what is held: the same on any machine of one word size, whatever its allocator.

/// Bytes that a list has room for; what its elements hold elsewhere comes on top.
#[must_use]
pub fn list<T>(list: &Vec<T>) -> usize {
    list.capacity() * size_of::<T>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_counts_used_or_not() {
        let mut some: Vec<u32> = Vec::with_capacity(9);
        some.push(1);
        assert_eq!(list(&some), some.capacity() * 4);
        assert_eq!(list(&Vec::<u64>::new()), 0);
    }
}
