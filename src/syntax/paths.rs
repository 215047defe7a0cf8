//! Access rules: the files that a graph may read, and the names that it may give to output files.

use std::path::{Component, Path, PathBuf};

use crate::{Help, nearest};

/// The file that marks the root of a project.
pub const MARKER: &str = "maquette.toml";

/// Returns the nearest ancestor folder that contains `maquette.toml`. If there is none, returns `folder`, the folder of the graph.
pub fn project_root(folder: &Path) -> PathBuf {
    let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    let root = folder.ancestors().find(|above| above.join(MARKER).is_file());
    root.unwrap_or(&folder).to_owned()
}

/// Error returned by [`may_read`].
#[derive(Clone, Debug, PartialEq)]
pub enum PathError {
    Outside { message: String, help: Help },
    Missing { message: String, help: Help },
}

/// Checks that a graph may read the file `resolved`. `given` is the path as the graph contains it. The file is not opened.
pub fn may_read(given: &str, resolved: &Path, roots: &[PathBuf]) -> Result<(), PathError> {
    fn outside_error(what: &str, given: &str, roots: &[PathBuf]) -> PathError {
        PathError::Outside {
        message: format!("`{given}` {what} outside of the project"),
        help: format!(
            "move the file into {}, put a {MARKER} into a folder above both, or allow its folder with --root",
            roots.first().map_or_else(String::new, |root| root.display().to_string())
        )
        .into(),
    }
    }
    if Path::new(given).is_absolute() {
        return Err(PathError::Outside {
            message: format!("`{given}` is an absolute path, which leads outside of the project"),
            help: "write the path relative to the graph's file".into(),
        });
    }
    fn is_inside(path: &Path, roots: &[PathBuf]) -> bool {
        roots.iter().any(|root| path.starts_with(root))
    }
    if !is_inside(&without_dots(resolved), roots) {
        return Err(outside_error("lies", given, roots));
    }
    match std::fs::canonicalize(resolved) {
        Ok(real) if !is_inside(&real, roots) => {
            Err(outside_error("is a link to a file", given, roots))
        }
        Ok(real) if !real.is_file() => Err(PathError::Missing {
            message: format!("`{given}` is not a file"),
            help: Help::default(),
        }),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(PathError::Missing {
            message: format!("there is no file `{given}`"),
            help: suggest_file(resolved),
        }),
        Err(error) => Err(PathError::Missing {
            message: format!("`{given}` cannot be read: {error}"),
            help: Help::default(),
        }),
    }
}

/// Suggests the most similar file name in the folder of a missing file.
fn suggest_file(path: &Path) -> Help {
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

/// Removes `.` and `..` from a path without accessing the file system.
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

/// Returns the folder of a file, without symbolic links and without `.` and `..`. The file need not exist.
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

/// Returns the relative path from a folder to a file. Neither path may contain `.` or `..`.
pub fn path_between(folder: &Path, file: &Path) -> String {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = file.components().skip(common);
    let down = down.map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// Returns the path of a file relative to the root of the project. If the file is outside of the project, returns only its name.
pub fn relative_to_root(root: &Path, path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| without_dots(folder));
    let whole = folder.join(name);
    let inside = whole.strip_prefix(root).unwrap_or(Path::new(name));
    let parts = inside.components().map(|part| part.as_os_str().to_string_lossy());
    parts.collect::<Vec<_>>().join("/")
}

/// Returns true if the name of an output file is a path inside of the output folder.
pub fn is_inside_output_folder(name: &str) -> bool {
    !name.is_empty()
        && !name.contains(['\\', '\0'])
        && !name.ends_with('/')
        && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_names_outside_of_the_folder_are_rejected() {
        for name in ["a.ply", "renders/a.png", "a..b.ply"] {
            assert!(is_inside_output_folder(name), "{name}");
        }
        for name in ["", "../a.ply", "/a.ply", "b/../../a.ply", "a/", "..\\a.ply"] {
            assert!(!is_inside_output_folder(name), "{name}");
        }
    }

    #[test]
    fn a_link_to_a_file_outside_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let root = std::fs::canonicalize(folder.path()).unwrap();
        let (project, secret) = (root.join("project"), root.join("secret.obj"));
        std::fs::create_dir(&project).unwrap();
        std::fs::write(&secret, "").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&secret, project.join("link.obj")).unwrap();
        let check =
            |given: &str| may_read(given, &project.join(given), std::slice::from_ref(&project));
        assert!(matches!(check("../secret.obj"), Err(PathError::Outside { .. })));
        #[cfg(unix)]
        assert!(matches!(check("link.obj"), Err(PathError::Outside { .. })));
        assert!(
            matches!(check("lnik.obj"), Err(PathError::Missing { help, .. }) if help.to_string().contains("link.obj"))
        );
    }
}
