//! Linker scripts: each program's own memory map, from the board's layout.

#[path = "../../update/src/stm32h743.rs"]
#[expect(dead_code, reason = "the programs use the rest")]
mod layout;

use layout::{ACTIVE, FLASH_BASE, HEADER, LOADER, Part, RAM_BASE, RAM_SIZE};
use std::path::PathBuf;
use std::{env, fs};

fn main() -> std::io::Result<()> {
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
    let code = Part { offset: ACTIVE.offset + HEADER, size: ACTIVE.size - HEADER };
    for (program, part) in [("loader", LOADER), ("application", code)] {
        let folder = out.join(program);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("memory.x"), memory(&part))?;
        println!("cargo:rustc-link-arg-bin={program}=-L{}", folder.display());
    }
    for argument in ["--nmagic", "-Tlink.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    println!("cargo:rerun-if-changed=../../update/src/stm32h743.rs");
    Ok(())
}

fn memory(part: &Part) -> String {
    let Part { offset, size } = part;
    format!(
        "MEMORY {{\n  FLASH : ORIGIN = {:#x}, LENGTH = {size:#x}\n  RAM : ORIGIN = {RAM_BASE:#x}, LENGTH = {RAM_SIZE:#x}\n}}\n",
        FLASH_BASE + offset
    )
}
