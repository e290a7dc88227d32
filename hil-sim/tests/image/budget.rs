//! What the image costs, and what it may cost: the table in `firmware/README.md`.

use super::planes;
use hil_sim::image::SharedImage;
use hil_sim::image::costs::KINDS;
use std::fs;
use std::path::Path;

/// A quarter of a plane at 240 Hz on a processor of 168 MHz, were an instruction a cycle.
const PLANE_INSTRUCTIONS: u64 = 7_000;
/// A packet of the host is opened, its plane expanded and checked, and its answer made on top of each other: without a host it takes 5,100. An expander
/// of 3 KiB is made there before it goes to its place.
const STACK_BYTES: u64 = 12 * 1024;
/// 55 KiB of it are the host's end: messages, their packets, planes that expand; 16 are the three other ways to keep step.
const FLASH_BYTES: u64 = 152 * 1024;
/// The longest packet, of 16 KiB, is checked before it is believed; a plane that expands takes 3 KiB.
const RAM_BYTES: u64 = 24 * 1024;

/// What expanding a plane may take; see [`planes`](crate::planes).
const EXPANDING_INSTRUCTIONS: [u64; planes::KINDS.len()] = [1_000_000, 2_000_000, 3_000_000];

/// Where the machine's RAM begins.
const RAM: u32 = 0x2000_0000;

/// A line of the table.
struct Line {
    what: String,
    value: u64,
    unit: &'static str,
    most: Option<u64>,
}

/// Worst cases of several images of one file.
pub struct Budget(Vec<Line>);

impl Budget {
    /// Asks `images`, which run the file `elf` and take `expanding` instructions for a plane of each of [`planes::KINDS`].
    pub fn of<'a>(
        images: impl Iterator<Item = &'a SharedImage>,
        elf: &Path,
        expanding: [u64; planes::KINDS.len()],
    ) -> Self {
        let (mut kinds, mut plane, mut stack) = ([0; KINDS.len()], 0, 0);
        for image in images {
            let mut image = image.lock();
            stack = stack.max(image.stack_bytes().unwrap().into());
            plane = plane.max(image.costs().plane().instructions);
            for (most, kind) in kinds.iter_mut().zip(image.costs().kinds()) {
                *most = kind.instructions.max(*most);
            }
        }
        let (flash, ram) = sizes(&fs::read(elf).unwrap());
        // A plane has room for one of each, and for a plane pulse at either end.
        let together = kinds.iter().sum::<u64>() + kinds[2];
        let steps = KINDS.iter().zip(kinds).map(|(kind, value)| (format!("step: {kind}"), value, "instructions", None));
        let rest = [
            (
                "one of each and a second plane pulse, were all at their dearest".to_owned(),
                together,
                "instructions",
                None,
            ),
            ("all steps within the time of a plane".to_owned(), plane, "instructions", Some(PLANE_INSTRUCTIONS)),
            ("stack".to_owned(), stack, "bytes", Some(STACK_BYTES)),
            ("flash".to_owned(), flash, "bytes", Some(FLASH_BYTES)),
            ("RAM without the stack".to_owned(), ram, "bytes", Some(RAM_BYTES)),
        ];
        let expanding = planes::KINDS.iter().zip(expanding).zip(EXPANDING_INSTRUCTIONS).map(|((kind, value), most)| {
            (format!("a plane of 768 x 768 pixels: {kind}"), value, "instructions", Some(most))
        });
        let lines = steps.chain(rest).chain(expanding);
        Self(lines.map(|(what, value, unit, most)| Line { what, value, unit, most }).collect())
    }

    /// Whether nothing exceeds what is allowed.
    pub fn is_kept(&self) -> bool {
        self.0.iter().all(|line| line.most.is_none_or(|most| line.value <= most))
    }

    /// Markdown.
    pub fn table(&self) -> String {
        let row = |line: &Line| {
            let most = line.most.map_or(String::new(), thousands);
            format!("| {} | {} {} | {most} |\n", line.what, thousands(line.value), line.unit)
        };
        let rows: String = self.0.iter().map(row).collect();
        format!("| what | worst seen | budget |\n|---|---|---|\n{rows}")
    }

    /// Puts the table into its place.
    pub fn write(&self) {
        let readme = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/README.md");
        let text = fs::read_to_string(&readme).unwrap();
        let (before, rest) = text.split_once("<!-- budget -->\n").expect("a place for the table");
        let (_, after) = rest.split_once("<!-- end of budget -->").expect("its end");
        let table = self.table();
        fs::write(readme, format!("{before}<!-- budget -->\n{table}<!-- end of budget -->{after}")).unwrap();
    }
}

fn thousands(value: u64) -> String {
    if value < 1_000 { value.to_string() } else { format!("{},{:03}", thousands(value / 1_000), value % 1_000) }
}

/// Flash and RAM that the segments of an ELF file take, bytes.
fn sizes(elf: &[u8]) -> (u64, u64) {
    let word = |at: usize| u32::from_le_bytes(elf[at..at + 4].try_into().unwrap());
    let half = |at: usize| usize::from(u16::from_le_bytes(elf[at..at + 2].try_into().unwrap()));
    assert_eq!((&elf[..4], elf[4]), (&b"\x7fELF"[..], 1), "an ELF file of 32 bits");
    let (first, size, count) = (word(28) as usize, half(42), half(44));
    let loaded = (0..count).map(|i| first + i * size).filter(|&at| word(at) == 1);
    loaded.fold((0, 0), |(flash, ram), at| {
        let (address, in_file, in_memory) = (word(at + 8), word(at + 16), word(at + 20));
        (flash + u64::from(in_file), ram + if address >= RAM { u64::from(in_memory) } else { 0 })
    })
}
