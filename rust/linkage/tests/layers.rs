//! The modules of this crate form layers: no module uses one at or above its own place in the
//! table of the crate's documentation.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The modules in the table under "# Layers", lowest first.
fn layers(lib: &str) -> Vec<String> {
    let table = lib.split("//! # Layers").nth(1).unwrap();
    table
        .lines()
        .take_while(|line| !line.starts_with("//! # "))
        .filter_map(|line| line.strip_prefix("//! | [`")?.split_once("`]"))
        .map(|(name, _)| name.trim_start_matches("mod@").to_owned())
        .collect()
}

/// The names that follow `crate::` in code, comments excluded.
fn crate_paths(source: &str) -> impl Iterator<Item = String> {
    source
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .flat_map(|code| code.split("crate::").skip(1))
        .map(|rest| {
            let is_name = |c: char| c.is_alphanumeric() || c == '_';
            rest.chars().take_while(|&c| is_name(c)).collect()
        })
}

/// Uses that point up or sideways, and modules without a layer.
fn violations(layers: &[String], sources: &BTreeMap<String, String>) -> Vec<String> {
    let layer = |name: &str| layers.iter().position(|layer| layer == name);
    let mut found = Vec::new();
    for (module, source) in sources {
        let Some(own_layer) = layer(module) else {
            found.push(format!("{module} is not in the table"));
            continue;
        };
        for used in crate_paths(source).filter(|used| used != module) {
            if layer(&used).is_none_or(|used_layer| used_layer >= own_layer) {
                found.push(format!("{module} uses {used}"));
            }
        }
    }
    found
}

/// The source text of every module but the root; submodules count as their parent.
fn read_sources(folder: &Path) -> BTreeMap<String, String> {
    let mut sources = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let module = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let parts = read_sources(&path).into_values();
            sources.insert(module, parts.collect::<Vec<_>>().join("\n"));
        } else if module != "lib" {
            sources.insert(module, fs::read_to_string(&path).unwrap());
        }
    }
    sources
}

#[test]
fn modules_use_lower_layers_only() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let layers = layers(&fs::read_to_string(folder.join("lib.rs")).unwrap());
    let sources = read_sources(&folder);
    assert_eq!(violations(&layers, &sources), Vec::<String>::new());
    let mut modules: Vec<_> = sources.into_keys().collect();
    let mut table = layers;
    modules.sort();
    table.sort();
    assert_eq!(modules, table);
}

#[test]
fn violations_of_cycle_are_found() {
    let lib =
        "//! # Layers\n//! | [`low`] | a |\n//! | [`mod@high`] | b |\n//! # End\n//! | [`x`] |\n";
    let layers = layers(lib);
    assert_eq!(layers, ["low", "high"]);
    let sources = |low: &str, high: &str| {
        BTreeMap::from([("low", low), ("high", high)].map(|(k, v)| (k.to_owned(), v.to_owned())))
    };
    let good = sources("use std::fmt; // crate::high", "use crate::low::{A, B};");
    assert_eq!(violations(&layers, &good), Vec::<String>::new());
    let cycle = sources("use crate::high::C;", "let x = crate::low::f(); crate::Error");
    assert_eq!(violations(&layers, &cycle), ["high uses Error", "low uses high"]);
    let unknown = BTreeMap::from([("other".to_owned(), String::new())]);
    assert_eq!(violations(&layers, &unknown), ["other is not in the table"]);
}
