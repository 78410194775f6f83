//! Slow and plain: what the fast paths are held against.
