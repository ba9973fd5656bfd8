//! The figure of a scene as a GLB file: meshes, skin and base colours, without animations.

use std::collections::HashMap;
use std::fmt::{self, Write as _};

use glam::{DMat3, DQuat, DVec3};

use crate::mesh::{Material, Part};
use crate::{Scene, TooManyCorners};

const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// First bytes and media types of textures.
const IMAGES: [(&[u8], &str); 2] = [(b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg")];

/// What the figure of a GLB file has beside the meshes.
#[derive(Clone, Debug)]
pub struct Figure<'a> {
    /// Indices of the nodes that are joints, parents first; the first is the root.
    pub joints: &'a [usize],
    /// Their names.
    pub names: &'a [String],
    /// The bytes of textures that are not embedded, by name.
    pub textures: &'a HashMap<String, Vec<u8>>,
    /// Name of the program for `asset.generator`.
    pub generator: &'a str,
}

/// A figure as a GLB file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Glb {
    /// The bytes of the file.
    pub data: Vec<u8>,
    /// Names of textures that are missing or neither PNG nor JPEG.
    pub missing: Vec<String>,
}

/// Why a figure cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GlbError {
    /// The meshes have too many corners.
    TooManyCorners(TooManyCorners),
    /// A number is NaN or infinite.
    NotFinite,
    /// The file would have 4 GiB or more.
    TooLarge,
}

impl fmt::Display for GlbError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooManyCorners(error) => error.fmt(formatter),
            Self::NotFinite => formatter.write_str("expected finite numbers, got NaN or infinity"),
            Self::TooLarge => formatter.write_str("expected meshes and textures below 4 GiB"),
        }
    }
}

impl std::error::Error for GlbError {}

/// The binary chunk, and the JSON of its views and accessors.
#[derive(Default)]
struct Buffer {
    data: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl Buffer {
    /// Append bytes and return the index of their view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let (offset, length) = (self.data.len(), bytes.len());
        self.data.extend_from_slice(bytes);
        let target = target.map_or(String::new(), |own| format!(r#","target":{own}"#));
        self.views
            .push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}{target}}}"#));
        self.views.len() - 1
    }

    /// Append an array and return the index of its accessor; `more` are further entries.
    fn add(
        &mut self,
        bytes: &[u8],
        layout: (u32, &str, usize),
        target: Option<u32>,
        more: &str,
    ) -> usize {
        let view = self.view(bytes, target);
        let (component, kind, count) = layout;
        self.accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"count":{count},"type":"{kind}"{more}}}"#
        ));
        self.accessors.len() - 1
    }
}

impl Scene {
    /// Return the figure as a GLB file in metres; None without meshes or joints.
    ///
    /// The nodes are the joints in the rest pose, without scale, and the meshes. Vertices have their
    /// places in the rest pose. A mesh above which there is no joint has no skin. The scene must
    /// have been loaded with its geometry.
    ///
    /// # Errors
    ///
    /// If the triangles have more than `max_corners` corners, a number is not finite, or the file
    /// would have 4 GiB or more.
    pub fn to_glb(&self, figure: &Figure<'_>, max_corners: usize) -> Result<Option<Glb>, GlbError> {
        let parts = self.meshes(max_corners).map_err(GlbError::TooManyCorners)?;
        if parts.is_empty() || figure.joints.is_empty() {
            return Ok(None);
        }
        let movers = self.movers(figure.joints);
        let unit = self.root.settings.original_unit_meters;
        let mut buffer = Buffer::default();
        let mut nodes = self.joint_nodes(figure, &movers, unit)?;
        let inverse = self.inverse_bindings(figure.joints, unit, &mut buffer);
        let (mut roots, mut meshes, mut owner) = (vec![0], Vec::new(), None);
        let mut primitives: Vec<Vec<String>> = Vec::new();
        for part in &parts {
            let (primitive, is_skinned) = primitive(part, &movers, unit, &mut buffer)?;
            if owner != Some((part.node, is_skinned)) {
                let (name, mesh) = (quote(&part.name), primitives.len());
                let skin = if is_skinned { r#","skin":0"# } else { "" };
                roots.push(nodes.len());
                nodes.push(format!(r#"{{"name":{name},"mesh":{mesh}{skin}}}"#));
                meshes.push(name);
                primitives.push(Vec::new());
                owner = Some((part.node, is_skinned));
            }
            if let Some(last) = primitives.last_mut() {
                last.push(primitive);
            }
        }
        let meshes: Vec<String> = meshes
            .iter()
            .zip(&primitives)
            .map(|(name, own)| format!(r#"{{"name":{name},"primitives":[{}]}}"#, own.join(",")))
            .collect();
        let (materials, missing) = materials(&self.materials(), figure.textures, &mut buffer)?;
        buffer.data.resize(buffer.data.len().next_multiple_of(4), 0);
        let joints: Vec<usize> = (0..figure.joints.len()).collect();
        let document = format!(
            concat!(
                r#"{{"asset":{{"version":"2.0","generator":{}}},"scene":0,"scenes":[{{"nodes":{:?}}}],"#,
                r#""nodes":[{}],"meshes":[{}],"#,
                r#""skins":[{{"joints":{:?},"skeleton":0,"inverseBindMatrices":{}}}],"#,
                r#"{}"buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}}"#
            ),
            quote(figure.generator),
            roots,
            nodes.join(","),
            meshes.join(","),
            joints,
            inverse,
            materials,
            buffer.data.len(),
            buffer.views.join(","),
            buffer.accessors.join(","),
        );
        Ok(Some(Glb { data: pack(document, &buffer.data)?, missing }))
    }

    /// Return for every node the joint that moves it: itself, or the nearest joint above it.
    fn movers(&self, joints: &[usize]) -> Vec<Option<usize>> {
        let mut movers = vec![None; self.nodes.len()];
        for (joint, &node) in joints.iter().enumerate() {
            movers[node] = Some(joint);
        }
        for (index, node) in self.nodes.iter().enumerate() {
            movers[index] = movers[index].or_else(|| movers[node.parent?]);
        }
        movers
    }

    fn joint_nodes(
        &self,
        figure: &Figure<'_>,
        movers: &[Option<usize>],
        unit: f64,
    ) -> Result<Vec<String>, GlbError> {
        let poses = self.rest_pose();
        let parent_of = |joint: usize| {
            self.nodes[figure.joints[joint]]
                .parent
                .and_then(|own| movers[own])
        };
        let mut nodes = Vec::new();
        for (joint, (&node, name)) in figure.joints.iter().zip(figure.names).enumerate() {
            let rotation = DQuat::from_array(poses.rotations[node]);
            let place = DVec3::from(poses.positions[node]);
            let (above, origin) =
                parent_of(joint).map_or((DQuat::IDENTITY, DVec3::ZERO), |parent| {
                    let node = figure.joints[parent];
                    (DQuat::from_array(poses.rotations[node]), DVec3::from(poses.positions[node]))
                });
            let turn = (above.inverse() * rotation).normalize();
            let turn = turn.to_array().map(|own| own.clamp(-1.0, 1.0));
            let shift = above.inverse() * (place - origin) * unit;
            let children: Vec<usize> = (0..figure.joints.len())
                .filter(|&own| parent_of(own) == Some(joint))
                .collect();
            let children = if children.is_empty() {
                String::new()
            } else {
                format!(r#","children":{children:?}"#)
            };
            nodes.push(format!(
                r#"{{"name":{},"rotation":{},"translation":{}{children}}}"#,
                quote(name),
                numbers(&turn)?,
                numbers(&shift.to_array())?,
            ));
        }
        Ok(nodes)
    }

    fn inverse_bindings(&self, joints: &[usize], unit: f64, buffer: &mut Buffer) -> usize {
        let poses = self.rest_pose();
        let mut bytes = Vec::new();
        for &node in joints {
            let inverse = DMat3::from_quat(DQuat::from_array(poses.rotations[node]).inverse());
            let shift = -(inverse * DVec3::from(poses.positions[node]) * unit);
            let columns = [inverse.x_axis, inverse.y_axis, inverse.z_axis, shift];
            for (column, last) in columns.into_iter().zip([0.0, 0.0, 0.0, 1.0]) {
                extend(&mut bytes, &[column.x, column.y, column.z, last]);
            }
        }
        buffer.add(&bytes, (FLOAT, "MAT4", joints.len()), None, "")
    }
}

/// Add the triangles of one material; return the primitive and whether joints move it.
fn primitive(
    part: &Part,
    movers: &[Option<usize>],
    unit: f64,
    buffer: &mut Buffer,
) -> Result<(String, bool), GlbError> {
    let (mut positions, mut low, mut high) = (Vec::new(), [f32::MAX; 3], [f32::MIN; 3]);
    for position in &part.positions {
        let place = position.map(|own| (own * unit) as f32);
        for (axis, value) in place.into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
            positions.extend(value.to_le_bytes());
        }
        if !place.iter().all(|own| own.is_finite()) {
            return Err(GlbError::NotFinite);
        }
    }
    let n = part.positions.len();
    let bounds = [low, high].map(|own| own.map(f64::from));
    let bounds = format!(r#","min":{},"max":{}"#, numbers(&bounds[0])?, numbers(&bounds[1])?);
    let target = Some(ARRAY_BUFFER);
    let place = buffer.add(&positions, (FLOAT, "VEC3", n), target, &bounds);
    let normals: Vec<u8> = part
        .normals
        .iter()
        .flatten()
        .flat_map(|own| own.to_le_bytes())
        .collect();
    let normal = buffer.add(&normals, (FLOAT, "VEC3", n), target, "");
    let mut attributes = format!(r#""POSITION":{place},"NORMAL":{normal}"#);
    if !part.uvs.is_empty() {
        let flipped = part.uvs.iter().flat_map(|&[u, v]| [u, 1.0 - v]);
        let bytes: Vec<u8> = flipped.flat_map(f32::to_le_bytes).collect();
        let uv = buffer.add(&bytes, (FLOAT, "VEC2", n), target, "");
        let _ = write!(attributes, r#","TEXCOORD_0":{uv}"#);
    }
    let mover = |node: i64| {
        usize::try_from(node)
            .ok()
            .and_then(|own| movers.get(own).copied()?)
    };
    let is_skinned = part.joints.iter().any(|own| mover(own[0]).is_some());
    if is_skinned {
        let is_small = movers.iter().flatten().max().is_none_or(|&own| own < 256);
        let mut bytes = Vec::new();
        for (joints, weights) in part.joints.iter().zip(&part.weights) {
            for (&node, &weight) in joints.iter().zip(weights) {
                let joint = if weight > 0.0 { mover(node).unwrap_or(0) } else { 0 };
                let [first, second, ..] = joint.to_le_bytes();
                bytes.push(first);
                if !is_small {
                    bytes.push(second);
                }
            }
        }
        let component = if is_small { UNSIGNED_BYTE } else { UNSIGNED_SHORT };
        let joints = buffer.add(&bytes, (component, "VEC4", n), target, "");
        let weights: Vec<u8> = part
            .weights
            .iter()
            .flatten()
            .flat_map(|own| own.to_le_bytes())
            .collect();
        let weights = buffer.add(&weights, (FLOAT, "VEC4", n), target, "");
        let _ = write!(attributes, r#","JOINTS_0":{joints},"WEIGHTS_0":{weights}"#);
    }
    let indices: Vec<u8> = part
        .triangles
        .iter()
        .flat_map(|own| own.to_le_bytes())
        .collect();
    let layout = (UNSIGNED_INT, "SCALAR", part.triangles.len());
    let indices = buffer.add(&indices, layout, Some(ELEMENT_ARRAY_BUFFER), "");
    let material = part
        .material
        .map_or(String::new(), |own| format!(r#","material":{own}"#));
    let text = format!(r#"{{"attributes":{{{attributes}}},"indices":{indices}{material}}}"#);
    Ok((text, is_skinned))
}

/// Return the JSON of materials, textures and images, and the names of missing textures.
fn materials(
    materials: &[Material],
    files: &HashMap<String, Vec<u8>>,
    buffer: &mut Buffer,
) -> Result<(String, Vec<String>), GlbError> {
    let (mut entries, mut images, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    let mut indices: HashMap<&str, usize> = HashMap::new();
    for material in materials {
        let [red, green, blue] = material.color;
        let mut surface = format!(
            r#""baseColorFactor":{},"metallicFactor":0"#,
            numbers(&[red, green, blue, 1.0].map(|own| own.clamp(0.0, 1.0)))?
        );
        if let Some((name, embedded)) = &material.texture {
            let data = if embedded.is_empty() { files.get(name) } else { Some(embedded) };
            let kind = data.and_then(|data| {
                IMAGES
                    .iter()
                    .find(|(start, _)| data.starts_with(start))
                    .map(|own| (data, own.1))
            });
            if let Some((data, media_type)) = kind {
                let index = *indices.entry(name).or_insert_with(|| {
                    let view = buffer.view(data, None);
                    images.push(format!(r#"{{"mimeType":"{media_type}","bufferView":{view}}}"#));
                    images.len() - 1
                });
                let _ = write!(surface, r#","baseColorTexture":{{"index":{index}}}"#);
            } else if !missing.contains(name) {
                missing.push(name.clone());
            }
        }
        let name = quote(&material.name);
        entries.push(format!(r#"{{"name":{name},"pbrMetallicRoughness":{{{surface}}}}}"#));
    }
    let textures: Vec<String> = (0..images.len())
        .map(|own| format!(r#"{{"source":{own}}}"#))
        .collect();
    let lists = [("materials", entries), ("textures", textures), ("images", images)];
    let filled = lists.iter().filter(|(_, own)| !own.is_empty());
    let lists: Vec<String> = filled
        .map(|(name, own)| format!(r#""{name}":[{}],"#, own.join(",")))
        .collect();
    Ok((lists.concat(), missing))
}

/// Return the bytes of a GLB file.
fn pack(mut document: String, data: &[u8]) -> Result<Vec<u8>, GlbError> {
    while !document.len().is_multiple_of(4) {
        document.push(' ');
    }
    let length = |own: usize| u32::try_from(own).map_err(|_| GlbError::TooLarge);
    let mut file = b"glTF".to_vec();
    file.extend(2u32.to_le_bytes());
    file.extend(length(28 + document.len() + data.len())?.to_le_bytes());
    for (kind, chunk) in [(b"JSON", document.as_bytes()), (b"BIN\0", data)] {
        file.extend(length(chunk.len())?.to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    Ok(file)
}

fn extend(bytes: &mut Vec<u8>, values: &[f64]) {
    bytes.extend(values.iter().flat_map(|&own| (own as f32).to_le_bytes()));
}

/// Return numbers as JSON.
fn numbers(values: &[f64]) -> Result<String, GlbError> {
    if values.iter().all(|own| own.is_finite()) {
        Ok(format!("{values:?}"))
    } else {
        Err(GlbError::NotFinite)
    }
}

/// Return a text as JSON.
fn quote(text: &str) -> String {
    let mut quoted = String::from('"');
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            own if u32::from(own) < 0x20 => {
                let _ = write!(quoted, "\\u{:04x}", u32::from(own));
            }
            own => quoted.push(own),
        }
    }
    quoted.push('"');
    quoted
}
