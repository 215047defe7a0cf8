//! Reproduces how editors and tools save a file: their system calls, in order. Programs that are installed are also run themselves
//! ([`programs`]).

use std::fs::{File, OpenOptions, remove_file, rename, write};
use std::io::{Result, Write};
use std::path::{Path, PathBuf};

type Save = fn(&Path, &str) -> Result<()>;

/// The known ways of saving a file, by program.
pub(crate) const SEQUENCES: [(&str, Save); 12] = [
    ("vim, neovim: backup by renaming", rename_write_delete),
    ("vim with `backupcopy=yes`", copy_truncate_write),
    ("emacs", emacs),
    ("VS Code, nano, cp", truncate_write),
    ("VS Code, slowly", truncate_pause_write),
    ("sed -i", temporary_and_rename),
    ("rsync", rsync),
    ("GNOME's editors", link_and_rename),
    ("JetBrains", two_renames),
    ("git checkout", delete_create),
    ("delete, create, slowly", delete_pause_create),
    ("in two pieces", two_pieces),
];

/// Commands of the installed programs that save `doll.ron`: the programs replace `OLD` by `NEW`, or copy `wanted.txt`.
pub(crate) fn programs() -> Vec<(&'static str, &'static str)> {
    let all = [
        ("vim", "vim -es -u NONE -c '%s/OLD/NEW/' -c wq doll.ron"),
        ("vim", "vim -es -u NONE -c 'set backup backupcopy=yes' -c '%s/OLD/NEW/' -c wq doll.ron"),
        ("nvim", "nvim -es -u NONE -c '%s/OLD/NEW/' -c wq doll.ron"),
        (
            "emacs",
            "emacs -Q --batch doll.ron --eval '(progn (search-forward \"OLD\") (replace-match \"NEW\") (save-buffer))'",
        ),
        ("sed", "sed -i 's/OLD/NEW/' doll.ron"),
        ("cp", "cp wanted.txt doll.ron"),
        ("mv", "cp wanted.txt new.txt && mv new.txt doll.ron"),
        ("rsync", "rsync --ignore-times wanted.txt doll.ron"),
        ("rsync", "rsync --inplace --ignore-times wanted.txt doll.ron"),
        ("tee", "tee doll.ron < wanted.txt > tee.txt"),
    ];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let is_there =
        |name: &str| std::env::split_paths(&path).any(|folder| folder.join(name).is_file());
    let unix = cfg!(unix);
    all.into_iter().filter(|(program, _)| unix && is_there(program)).collect()
}

/// Returns `path` with a prefix and a suffix added to its file name.
fn sibling(path: &Path, before: &str, after: &str) -> PathBuf {
    let name = path.file_name().unwrap().to_string_lossy();
    path.with_file_name(format!("{before}{name}{after}"))
}

fn rename_write_delete(path: &Path, text: &str) -> Result<()> {
    let (swap, probe, backup) =
        (sibling(path, ".", ".swp"), path.with_file_name("4913"), sibling(path, "", "~"));
    write(&swap, "swap")?;
    write(&probe, "")?;
    remove_file(&probe)?;
    rename(path, &backup)?;
    let mut file = File::create(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    drop(file);
    remove_file(backup)?;
    remove_file(swap)
}

fn copy_truncate_write(path: &Path, text: &str) -> Result<()> {
    let backup = sibling(path, "", "~");
    std::fs::copy(path, &backup)?;
    truncate_write(path, text)?;
    remove_file(backup)
}

fn emacs(path: &Path, text: &str) -> Result<()> {
    let (lock, autosave, backup) =
        (sibling(path, ".#", ""), sibling(path, "#", "#"), sibling(path, "", "~"));
    #[cfg(unix)]
    std::os::unix::fs::symlink("user@host.1:2", &lock)?;
    write(&autosave, text)?;
    rename(path, backup)?;
    write(path, text)?;
    remove_file(autosave)?;
    #[cfg(unix)]
    remove_file(lock)?;
    Ok(())
}

fn truncate_write(path: &Path, text: &str) -> Result<()> {
    write(path, text)
}

fn truncate_pause_write(path: &Path, text: &str) -> Result<()> {
    let mut file = OpenOptions::new().write(true).truncate(true).open(path)?;
    std::thread::sleep(std::time::Duration::from_millis(40));
    file.write_all(text.as_bytes())
}

fn temporary_and_rename(path: &Path, text: &str) -> Result<()> {
    let temporary = path.with_file_name("sedXk3lQp");
    write(&temporary, text)?;
    rename(temporary, path)
}

fn rsync(path: &Path, text: &str) -> Result<()> {
    let temporary = sibling(path, ".", ".Jx81aB");
    let mut file = File::create(&temporary)?;
    file.write_all(text.as_bytes())?;
    file.set_modified(
        std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1_000_000_000),
    )?;
    drop(file);
    rename(temporary, path)
}

fn link_and_rename(path: &Path, text: &str) -> Result<()> {
    let (temporary, backup) =
        (path.with_file_name(".goutputstream-X5W3Q1"), sibling(path, "", "~"));
    write(&temporary, text)?;
    let _ = remove_file(&backup);
    std::fs::hard_link(path, &backup)?;
    rename(temporary, path)
}

fn two_renames(path: &Path, text: &str) -> Result<()> {
    let (new, old) = (sibling(path, "", "___jb_tmp___"), sibling(path, "", "___jb_old___"));
    write(&new, text)?;
    rename(path, &old)?;
    rename(new, path)?;
    remove_file(old)
}

fn delete_create(path: &Path, text: &str) -> Result<()> {
    remove_file(path)?;
    write(path, text)
}

fn delete_pause_create(path: &Path, text: &str) -> Result<()> {
    remove_file(path)?;
    std::thread::sleep(std::time::Duration::from_millis(40));
    write(path, text)
}

fn two_pieces(path: &Path, text: &str) -> Result<()> {
    let mut file = File::create(path)?;
    let (first, second) = text.as_bytes().split_at(text.len() / 2);
    file.write_all(first)?;
    file.write_all(second)
}
