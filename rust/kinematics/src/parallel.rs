//! Work that is shared out among threads.

use std::sync::Mutex;
use std::thread;

/// Call `work` with every part, on as many threads as there are parts.
///
/// The caller's thread takes parts, too. If the system has no memory for a thread, the others do
/// its part.
pub(crate) fn for_each_part<T: Send>(
    parts: impl ExactSizeIterator<Item = T> + Send,
    work: impl Fn(T) + Sync,
) {
    let n_helpers = parts.len().saturating_sub(1);
    let parts = Mutex::new(parts);
    let next_part = || parts.lock().ok().and_then(|mut parts| parts.next());
    let help = || {
        while let Some(part) = next_part() {
            work(part);
        }
    };
    thread::scope(|scope| {
        for _ in 0..n_helpers {
            let helper = thread::Builder::new().spawn_scoped(scope, help);
            if helper.is_err() {
                break;
            }
        }
        help();
    });
}
