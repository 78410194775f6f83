//! Files: one module a format, readers and writers. Readers allocate no more than the file can back; writers make
//! files that appear whole or not at all.

pub mod bsh;
pub mod whole;
