//! What kernels ask of the machine: an instruction set, threads and memory.
//!
//! | module | contents |
//! |---|---|
//! | [`instructions`] | the instruction set that inner loops use, detected at run time |
//! | [`memory`] | vectors whose memory the system may refuse |
//! | [`threads`] | threads that live as long as one call |

pub mod instructions;
pub mod memory;
pub mod threads;
