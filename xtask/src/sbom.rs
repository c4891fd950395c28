//! The bill of materials in CycloneDX's form: every package that can be in a build, with version, checksum and licence.
//!
//! Made of `Cargo.lock` and `cargo metadata` alone and without time or chance, so that the same packages give the same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use gnp::Progress as _;
use gnp_cli::Terminal;
use serde::{Deserialize, Serialize};

use crate::workspace::{self, Lock, Locked};

/// The document.
const DOCUMENT: &str = "docs/sbom.cdx.json";

/// The package whose program is the product.
const PROGRAM: &str = "gnp-cli";

/// Version of CycloneDX.
const SPECIFICATION: &str = "1.6";

/// Packages named in a finding; the others are counted.
const NAMED: usize = 5;

/// A package in the document.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Component {
    #[serde(rename = "type")]
    kind: String,
    #[serde(rename = "bom-ref")]
    reference: String,
    name: String,
    version: String,
    /// `required`: compiled into the program on some platform, by default; `optional`: with a feature, or only to build, test
    /// or measure; `excluded`: locked, but no feature of ours reaches it.
    scope: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    hashes: Vec<Hash>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    licenses: Vec<Licence>,
    purl: String,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Hash {
    alg: String,
    content: String,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Licence {
    expression: String,
}

/// What needs what.
#[derive(Debug, Serialize)]
struct Needs {
    #[serde(rename = "ref")]
    reference: String,
    #[serde(rename = "dependsOn")]
    on: Vec<String>,
}

/// As much of the document as is held against `Cargo.lock`.
#[derive(Deserialize)]
struct Document {
    components: Vec<Component>,
}

/// What `cargo metadata` tells of all packages.
#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: String,
    license: Option<String>,
}

/// Names and versions.
type Packages = BTreeSet<(String, String)>;

/// Writes the document.
///
/// # Errors
/// When cargo does not tell, or the file cannot be written.
pub(crate) fn write(root: &Path, terminal: &Terminal) -> Result<()> {
    let known: Metadata = workspace::metadata(root, &["--locked", "--all-features"])?;
    let linked = tree(root, &["--package", PROGRAM, "--edges", "normal,no-proc-macro"])?;
    let reached = tree(root, &["--workspace", "--all-features", "--edges", "normal,build,dev"])?;
    let lock = workspace::lock(root)?;
    let text = document(&lock, &known.packages, &linked, &reached)?;
    let path = root.join(DOCUMENT);
    gnp_file::save(&path, text.as_bytes()).with_context(|| format!("cannot write {DOCUMENT}"))?;
    terminal.note(&format!("{DOCUMENT}: {} packages", lock.package.len()));
    Ok(())
}

/// Findings where the document and `Cargo.lock` differ in names, versions or checksums.
///
/// # Errors
/// When one of the two cannot be read.
pub(crate) fn check(root: &Path) -> Result<Vec<String>> {
    let text = std::fs::read_to_string(root.join(DOCUMENT)).with_context(|| format!("cannot read {DOCUMENT}"))?;
    let document: Document = serde_json::from_str(&text).with_context(|| DOCUMENT.to_owned())?;
    Ok(differences(&document.components, &workspace::lock(root)?))
}

fn differences(components: &[Component], lock: &Lock) -> Vec<String> {
    let listed: BTreeSet<_> = components
        .iter()
        .map(|it| (it.name.as_str(), it.version.as_str(), it.hashes.first().map(|hash| hash.content.as_str())))
        .collect();
    let locked: BTreeSet<_> =
        lock.package.iter().map(|it| (it.name.as_str(), it.version.as_str(), it.checksum.as_deref())).collect();
    let names = |of: Vec<&(&str, &str, Option<&str>)>| {
        let more = of.len().saturating_sub(NAMED);
        let named: Vec<String> = of.iter().take(NAMED).map(|(name, version, _)| format!("{name} {version}")).collect();
        named.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
    };
    let mut findings = Vec::new();
    for (what, of) in [
        ("does not list, as Cargo.lock has them,", locked.difference(&listed).collect::<Vec<_>>()),
        ("lists what Cargo.lock does not have:", listed.difference(&locked).collect()),
    ] {
        if !of.is_empty() {
            findings.push(format!("{DOCUMENT} {what} {}; make it anew: cargo xtask sbom", names(of)));
        }
    }
    findings
}

/// What is reached on any platform. `cargo metadata` would not do: it lists optional dependencies that no feature switches on.
fn tree(root: &Path, arguments: &[&str]) -> Result<Packages> {
    let output = workspace::cargo()
        .args(["tree", "--locked", "--target", "all", "--prefix", "none", "--format", "{p}"])
        .args(arguments)
        .current_dir(root)
        .output()
        .context("cannot start cargo tree")?;
    if !output.status.success() {
        bail!("cargo tree: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(listed(&String::from_utf8_lossy(&output.stdout)))
}

/// Packages of lines such as `snap v1.1.2 (where it is)`.
fn listed(text: &str) -> Packages {
    let package = |line: &str| {
        let mut words = line.split(' ');
        Some((words.next()?.to_owned(), words.next()?.strip_prefix('v')?.to_owned()))
    };
    text.lines().filter_map(package).collect()
}

/// The whole text: a line for each package and for what it needs, so that a change is a short one.
fn document(lock: &Lock, known: &[Package], linked: &Packages, reached: &Packages) -> Result<String> {
    let licences: BTreeMap<(&str, &str), &str> =
        known.iter().filter_map(|it| Some(((it.name.as_str(), it.version.as_str()), it.license.as_deref()?))).collect();
    let components = lock.package.iter().map(|locked| {
        let package = (locked.name.clone(), locked.version.clone());
        let scope = match (linked.contains(&package), reached.contains(&package)) {
            (true, _) => "required",
            (false, true) => "optional",
            (false, false) => "excluded",
        };
        let licence = licences.get(&(locked.name.as_str(), locked.version.as_str()));
        // The old way to write a choice.
        let licence = licence.map(|text| text.split('/').map(str::trim).collect::<Vec<_>>().join(" OR "));
        let content = locked.checksum.clone();
        component(Component {
            kind: if locked.name == PROGRAM { "application" } else { "library" }.to_owned(),
            reference: reference(locked),
            name: locked.name.clone(),
            version: locked.version.clone(),
            scope: scope.to_owned(),
            hashes: content.map(|content| Hash { alg: "SHA-256".to_owned(), content }).into_iter().collect(),
            licenses: licence.map(|expression| Licence { expression }).into_iter().collect(),
            purl: format!("pkg:cargo/{}@{}", locked.name, locked.version.replace('+', "%2B")),
        })
    });
    let components: Vec<String> = components.collect::<Result<_>>()?;
    let needs: Vec<String> = lock.package.iter().map(|locked| needs(locked, lock)).collect::<Result<_>>()?;
    let program = lock.package.iter().find(|it| it.name == PROGRAM).context("Cargo.lock lacks the program")?;
    let about = serde_json::json!({
        "component": {"type": "application", "bom-ref": "gnp", "name": "gnp", "version": program.version}
    });
    let top = serde_json::to_string(&Needs { reference: "gnp".to_owned(), on: vec![reference(program)] })?;
    Ok(format!(
        "{{\n\"bomFormat\": \"CycloneDX\",\n\"specVersion\": \"{SPECIFICATION}\",\n\"version\": 1,\n\"metadata\": {about},\n\
         \"components\": [\n{}\n],\n\"dependencies\": [\n{top},\n{}\n]\n}}\n",
        components.join(",\n"),
        needs.join(",\n")
    ))
}

fn component(it: Component) -> Result<String> {
    serde_json::to_string(&it).with_context(|| it.reference)
}

fn reference(locked: &Locked) -> String {
    format!("{}@{}", locked.name, locked.version)
}

fn needs(of: &Locked, lock: &Lock) -> Result<String> {
    let found = |entry: &String| {
        let mut words = entry.split(' ');
        let (name, version) = (words.next().unwrap_or_default(), words.next());
        let fits = |it: &&Locked| it.name == name && version.is_none_or(|version| it.version == version);
        lock.package.iter().find(fits).map(reference).with_context(|| format!("Cargo.lock lacks {entry}"))
    };
    let on = of.dependencies.iter().map(found).collect::<Result<_>>()?;
    Ok(serde_json::to_string(&Needs { reference: reference(of), on })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOCK: &str = "\
[[package]]\nname = 'gnp-cli'\nversion = '0.1.0'\ndependencies = ['a', 'b 2.0.0+c', 'm']\n\
[[package]]\nname = 'a'\nversion = '1.0.0'\nchecksum = '00ff'\n\
[[package]]\nname = 'b'\nversion = '1.0.0'\nchecksum = '01'\n\
[[package]]\nname = 'b'\nversion = '2.0.0+c'\nchecksum = '02'\n\
[[package]]\nname = 'm'\nversion = '1.0.0'\nchecksum = '03'\ndependencies = ['b 1.0.0']\n\
[[package]]\nname = 'z'\nversion = '1.0.0'\nchecksum = '04'\n";

    /// The program has `a` in it; `b` 2 and the macro `m`, which needs `b` 1, are reached.
    fn made(lock: &Lock) -> String {
        let known = serde_json::json!([{"name": "a", "version": "1.0.0", "license": "MIT/Apache-2.0"},
            {"name": "b", "version": "1.0.0", "license": null}]);
        let linked = listed("gnp-cli v0.1.0 (here)\na v1.0.0\n");
        let reached = listed("gnp-cli v0.1.0 (here)\na v1.0.0\n\nm v1.0.0 (proc-macro)\nb v1.0.0\nb v2.0.0+c (*)\n");
        document(lock, &serde_json::from_value::<Vec<Package>>(known).unwrap(), &linked, &reached).unwrap()
    }

    #[test]
    fn every_locked_package_is_listed_with_its_part() {
        let lock: Lock = toml::from_str(LOCK).unwrap();
        let text = made(&lock);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let scopes: Vec<&str> =
            json["components"].as_array().unwrap().iter().map(|it| it["scope"].as_str().unwrap()).collect();
        assert_eq!(scopes, ["required", "required", "optional", "optional", "optional", "excluded"]);
        assert_eq!(json["components"][1]["hashes"][0]["content"], "00ff");
        assert_eq!(json["components"][1]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert!(json["components"][2]["licenses"].is_null());
        assert_eq!(json["components"][3]["purl"], "pkg:cargo/b@2.0.0%2Bc");
        assert_eq!(json["dependencies"][1]["dependsOn"], serde_json::json!(["a@1.0.0", "b@2.0.0+c", "m@1.0.0"]));
        let read: Document = serde_json::from_str(&text).unwrap();
        assert_eq!(differences(&read.components, &lock), [""; 0]);
    }

    #[test]
    fn a_list_that_is_out_of_date_is_found() {
        let lock: Lock = toml::from_str(LOCK).unwrap();
        let read: Document = serde_json::from_str(&made(&lock)).unwrap();
        let newer = |from: &str, to: &str| -> Lock { toml::from_str(&LOCK.replacen(from, to, 1)).unwrap() };
        for (lock, named) in [
            (newer("name = 'a'\nversion = '1.0.0'", "name = 'a'\nversion = '1.0.1'"), ["a 1.0.1", "a 1.0.0"]),
            (newer("00ff", "00fe"), ["a 1.0.0", "a 1.0.0"]),
        ] {
            let findings = differences(&read.components, &lock);
            assert_eq!(findings.len(), 2, "{findings:?}");
            assert!(findings.iter().zip(named).all(|(finding, name)| finding.contains(name)), "{findings:?}");
        }
        let many = LOCK.to_owned()
            + &(0..9).map(|i| format!("[[package]]\nname = 'n{i}'\nversion = '1.0.0'\n")).collect::<String>();
        let findings = differences(&read.components, &toml::from_str(&many).unwrap());
        assert!(findings.len() == 1 && findings[0].contains("n4 1.0.0 and 4 more"), "{findings:?}");
    }
}
