//! What this machine is, and what it has left.

use core::time::Duration;
use cpu_time::{ProcessTime, ThreadTime};
use serde::Serialize;
use std::fs;
use std::path::Path;
use thiserror::Error;

/// The machine that a measurement was made on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Machine {
    /// The processor's model, as it calls itself; its architecture where that is not known.
    pub processor: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Threads that render.
    pub threads: usize,
}

impl Machine {
    /// This one.
    pub fn here() -> Self {
        let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
        Self {
            processor: model.map_or(std::env::consts::ARCH, |(_, name)| name.trim()).to_string(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads: rayon::current_num_threads(),
        }
    }
}

/// Work that this machine has not the memory for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{what} needs about {:.1} GB of memory, and {:.1} GB are left", *needed as f64 / 1e9, *left as f64 / 1e9)]
pub struct NotEnoughMemory {
    /// What is to be done.
    pub what: &'static str,
    /// Bytes that it needs.
    pub needed: u64,
    /// Bytes that there are.
    pub left: u64,
}

/// Refuses `what` where it `needs` more bytes than are left. Where nobody says how many are, nothing is refused.
pub fn check_memory(what: &'static str, needed: u64) -> Result<(), NotEnoughMemory> {
    match memory_left() {
        Some(left) if needed > left => Err(NotEnoughMemory { what, needed, left }),
        _ => Ok(()),
    }
}

/// Bytes that this process can still have: the machine's, or its control group's or its limit's where those are fewer. Linux alone
/// says it.
pub fn memory_left() -> Option<u64> {
    let machine = kilobytes("/proc/meminfo", "MemAvailable:")?.min(left_in_limit().unwrap_or(u64::MAX));
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(groups.lines().filter_map(left_in_group).fold(machine, u64::min))
}

/// What `ulimit -v` still allows, where it is set.
fn left_in_limit() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(limit.saturating_sub(kilobytes("/proc/self/status", "VmSize:")?))
}

/// What a control group, a line `number:controllers:path` of `/proc/self/cgroup`, still allows. A cache that can be given back counts
/// as free.
fn left_in_group(line: &str) -> Option<u64> {
    let mut parts = line.splitn(3, ':').skip(1);
    let (controllers, path) = (parts.next()?, parts.next()?.trim_start_matches('/'));
    let (root, limit, usage) = match controllers {
        "" => ("/sys/fs/cgroup", "memory.max", "memory.current"),
        "memory" => ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"),
        _ => return None,
    };
    let folder = Path::new(root).join(path);
    let number = |name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
    let statistics = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
    let cache = statistics.lines().find_map(|line| line.strip_prefix("inactive_file ")?.parse().ok());
    Some(number(limit)?.saturating_sub(number(usage)?.saturating_sub(cache.unwrap_or(0))))
}

/// The most memory that this process has had so far, in bytes, with its program and libraries. Linux alone says it.
pub fn peak_memory() -> Option<u64> {
    kilobytes("/proc/self/status", "VmHWM:")
}

/// The line `key  number kB` of a file, in bytes.
fn kilobytes(file: &str, key: &str) -> Option<u64> {
    let text = fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The time that all threads of this process together have had a core.
pub fn processor_time() -> Option<Duration> {
    ProcessTime::try_now().ok().map(|time| time.as_duration())
}

/// The time that this thread has had a core.
pub fn thread_time() -> Option<Duration> {
    ThreadTime::try_now().ok().map(|time| time.as_duration())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_beyond_all_memory_is_refused_with_both_figures() {
        if memory_left().is_none() {
            return println!("skipped: this system does not say what memory is left");
        }
        assert_eq!(check_memory("nothing", 0), Ok(()));
        let text = check_memory("a world", 1 << 60).unwrap_err().to_string();
        assert!(text.starts_with("a world needs about 1152921504.6 GB of memory, and "), "{text}");
    }

    #[test]
    fn memory_and_time_that_are_used_are_seen() {
        let (Some(memory), Some(time)) = (peak_memory(), processor_time()) else {
            return println!("skipped: this system does not say what a process uses");
        };
        let filled = std::hint::black_box(vec![1u8; 300 << 20]);
        assert!(peak_memory().is_some_and(|peak| peak >= memory.max(300 << 20)), "{}", filled.len());
        let mut value = 1.0f64;
        while processor_time().is_some_and(|now| now < time + Duration::from_millis(20)) {
            value = std::hint::black_box(value).sqrt();
        }
    }
}
