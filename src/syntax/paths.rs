//! Which files a graph may read, and under which names it may write.

use std::path::{Component, Path, PathBuf};

use crate::{Help, nearest};

/// Marks the root of a project.
pub const MARKER: &str = "maquette.toml";

/// The nearest folder upwards from a graph's folder that holds `maquette.toml`, else the graph's folder itself.
pub fn project_root(folder: &Path) -> PathBuf {
    let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    let root = folder.ancestors().find(|above| above.join(MARKER).is_file());
    root.unwrap_or(&folder).to_owned()
}

/// Why a file cannot be read, and what to do.
#[derive(Clone, Debug, PartialEq)]
pub enum PathProblem {
    Outside { message: String, help: Help },
    Missing { message: String, help: Help },
}

/// Whether a graph may read `given`, which stands for `resolved`; looks only at names, opens nothing.
pub fn may_read(given: &str, resolved: &Path, roots: &[PathBuf]) -> Result<(), PathProblem> {
    fn outside(what: &str, given: &str, roots: &[PathBuf]) -> PathProblem {
        PathProblem::Outside {
        message: format!("`{given}` {what} outside of the project"),
        help: format!(
            "move the file into {}, put a {MARKER} into a folder above both, or allow its folder with --root",
            roots.first().map_or_else(String::new, |root| root.display().to_string())
        )
        .into(),
    }
    }
    if Path::new(given).is_absolute() {
        return Err(PathProblem::Outside {
            message: format!("`{given}` is an absolute path, which leads outside of the project"),
            help: "write the path relative to the graph's file".into(),
        });
    }
    fn inside(path: &Path, roots: &[PathBuf]) -> bool {
        roots.iter().any(|root| path.starts_with(root))
    }
    if !inside(&without_dots(resolved), roots) {
        return Err(outside("lies", given, roots));
    }
    match std::fs::canonicalize(resolved) {
        Ok(real) if !inside(&real, roots) => Err(outside("is a link to a file", given, roots)),
        Ok(real) if !real.is_file() => Err(PathProblem::Missing {
            message: format!("`{given}` is not a file"),
            help: Help::default(),
        }),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(PathProblem::Missing {
            message: format!("there is no file `{given}`"),
            help: similar(resolved),
        }),
        Err(error) => Err(PathProblem::Missing {
            message: format!("`{given}` cannot be read: {error}"),
            help: Help::default(),
        }),
    }
}

/// The file in the same folder whose name is nearest.
fn similar(path: &Path) -> Help {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return format!("there is no folder {}", folder.display()).into();
    };
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    nearest(&name, names.iter().map(String::as_str))
}

/// A path without `.` and `..`, by its text alone.
pub fn without_dots(path: &Path) -> PathBuf {
    let mut clean = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                clean.pop();
            }
            part => clean.push(part),
        }
    }
    clean
}

/// The folder of a file that may not be there yet, without links and dots.
pub fn folder_of_new(file: &Path) -> PathBuf {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = file.parent().unwrap_or(&file);
    let there = folder.ancestors().find_map(|folder| {
        let real = std::fs::canonicalize(folder).ok()?;
        Some((real, folder))
    });
    let Some((real, there)) = there else { return without_dots(folder) };
    without_dots(&real.join(folder.strip_prefix(there).unwrap_or(Path::new(""))))
}

/// The path that leads from a folder to a file, both without dots.
pub fn path_between(folder: &Path, file: &Path) -> String {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = file.components().skip(common);
    let down = down.map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// A path as it is told to others: from the root of the project on, or its last name alone where it lies elsewhere.
pub fn within(root: &Path, path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| without_dots(folder));
    let whole = folder.join(name);
    let inside = whole.strip_prefix(root).unwrap_or(Path::new(name));
    let parts = inside.components().map(|part| part.as_os_str().to_string_lossy());
    Vec::from_iter(parts).join("/")
}

/// Whether an output's name stays in the folder of outputs.
pub fn stays_inside(name: &str) -> bool {
    !name.is_empty()
        && !name.contains(['\\', '\0'])
        && !name.ends_with('/')
        && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder_of_outputs_are_known() {
        for name in ["a.ply", "renders/a.png", "a..b.ply"] {
            assert!(stays_inside(name), "{name}");
        }
        for name in ["", "../a.ply", "/a.ply", "b/../../a.ply", "a/", "..\\a.ply"] {
            assert!(!stays_inside(name), "{name}");
        }
    }

    #[test]
    fn a_link_to_a_file_outside_is_outside() {
        let folder = tempfile::tempdir().unwrap();
        let root = std::fs::canonicalize(folder.path()).unwrap();
        let (project, secret) = (root.join("project"), root.join("secret.obj"));
        std::fs::create_dir(&project).unwrap();
        std::fs::write(&secret, "").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&secret, project.join("link.obj")).unwrap();
        let check =
            |given: &str| may_read(given, &project.join(given), std::slice::from_ref(&project));
        assert!(matches!(check("../secret.obj"), Err(PathProblem::Outside { .. })));
        #[cfg(unix)]
        assert!(matches!(check("link.obj"), Err(PathProblem::Outside { .. })));
        assert!(
            matches!(check("lnik.obj"), Err(PathProblem::Missing { help, .. }) if help.to_string().contains("link.obj"))
        );
    }
}
