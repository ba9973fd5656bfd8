//! Meshes in the rest pose, with the nodes that move their vertices, and their materials.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fmt;

use glam::{DAffine3, DMat3, DVec3};

use crate::{Scene, hierarchy, to_affine, to_vector};

/// Nodes that move a vertex.
pub const MAX_INFLUENCES: usize = 4;

/// The triangles of a mesh that have one material. World positions are those of the rest pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Name of the node of the mesh.
    pub name: String,
    /// Index of the material, if there is one.
    pub material: Option<usize>,
    /// Index of the node of the mesh.
    pub node: usize,
    /// Three vertices per triangle.
    pub triangles: Vec<u32>,
    /// World positions of the vertices.
    pub positions: Vec<[f64; 3]>,
    /// World normals, unit vectors.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, with v upwards; empty if the mesh has none.
    pub uvs: Vec<[f32; 2]>,
    /// Indices of the nodes that move each vertex. A mesh without a skin moves with its node.
    pub joints: Vec<[i64; MAX_INFLUENCES]>,
    /// Weights of these nodes; their sum is 1.
    pub weights: Vec<[f32; MAX_INFLUENCES]>,
}

/// Base colour of a material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name.
    pub name: String,
    /// Linear RGB; white if there is a texture.
    pub color: [f64; 3],
    /// Relative file name of the texture and its embedded bytes, which may be empty.
    pub texture: Option<(String, Vec<u8>)>,
}

/// The meshes have more corners than the limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooManyCorners(pub usize);

impl fmt::Display for TooManyCorners {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "expected at most {} corners of triangles", self.0)
    }
}

impl std::error::Error for TooManyCorners {}

/// Where a vertex of a mesh is in the rest pose, and what moves it.
struct Bound {
    to_world: DAffine3,
    joints: [i64; MAX_INFLUENCES],
    weights: [f32; MAX_INFLUENCES],
}

impl Scene {
    /// Return the meshes of all nodes. The scene must have been loaded with its geometry.
    ///
    /// # Errors
    ///
    /// If the triangles have more than `max_corners` corners.
    pub fn meshes(&self, max_corners: usize) -> Result<Vec<Part>, TooManyCorners> {
        let indices = hierarchy::inverse(&self.ids);
        let mut parts = Vec::new();
        let mut n_corners = 0usize;
        for (index, &id) in self.ids.iter().enumerate() {
            let node = &self.root.nodes[id];
            let Some(mesh) = node.mesh.as_ref() else { continue };
            n_corners = n_corners.saturating_add(mesh.num_triangles.saturating_mul(3));
            if n_corners > max_corners {
                return Err(TooManyCorners(max_corners));
            }
            let bounds = self.bounds(node, mesh, index, &indices);
            for part in &mesh.material_parts {
                let found = self.part(node, mesh, part, &bounds, index);
                if !found.triangles.is_empty() {
                    parts.push(found);
                }
            }
        }
        Ok(parts)
    }

    /// Return the materials in the order of the file.
    pub fn materials(&self) -> Vec<Material> {
        (&self.root.materials).into_iter().map(material).collect()
    }

    fn bounds(
        &self,
        node: &ufbx::Node,
        mesh: &ufbx::Mesh,
        index: usize,
        indices: &[usize],
    ) -> Vec<Bound> {
        let rigid = || {
            let mut joints = [0; MAX_INFLUENCES];
            joints[0] = to_index(index);
            let to_world = self.nodes[index].rest * to_affine(&node.geometry_to_node);
            Bound { to_world, joints, weights: [1.0, 0.0, 0.0, 0.0] }
        };
        let Some(skin) = mesh.skin_deformers.first() else {
            return (0..mesh.num_vertices).map(|_| rigid()).collect();
        };
        let transforms: Vec<Option<(usize, DAffine3)>> = (&skin.clusters)
            .into_iter()
            .map(|cluster| {
                let bone = indices[cluster.bone_node.as_ref()?.element.typed_id as usize];
                let to_bone = to_affine(&cluster.geometry_to_bone);
                Some((bone, self.nodes[bone].rest * to_bone))
            })
            .collect();
        (0..mesh.num_vertices)
            .map(|vertex| skinned(skin, vertex, &transforms).unwrap_or_else(rigid))
            .collect()
    }

    fn part(
        &self,
        node: &ufbx::Node,
        mesh: &ufbx::Mesh,
        part: &ufbx::MeshPart,
        bounds: &[Bound],
        index: usize,
    ) -> Part {
        let which = part.index as usize;
        let material = node
            .materials
            .get(which)
            .or_else(|| mesh.materials.get(which));
        let mut found = Part {
            name: self.nodes[index].name.clone(),
            material: material.map(|own| own.element.typed_id as usize),
            node: index,
            ..Part::default()
        };
        let mut known: HashMap<(u32, [u32; 5]), u32> = HashMap::new();
        let mut corners = vec![0; mesh.max_face_triangles * 3];
        for &face in &part.face_indices {
            let n = mesh.triangulate_face(&mut corners, mesh.faces[face as usize]) as usize;
            for triangle in corners[..3 * n].chunks_exact(3) {
                let mut own = [0u32; 3];
                let mut is_mirrored = false;
                for (slot, &corner) in own.iter_mut().zip(triangle) {
                    let corner = corner as usize;
                    let vertex = mesh.vertex_indices[corner];
                    let Some(bound) = bounds.get(vertex as usize) else { continue };
                    is_mirrored = bound.to_world.matrix3.determinant() < 0.0;
                    let normal = normal(mesh, corner, bound);
                    let uv = uv(mesh, corner);
                    let bits = [normal[0], normal[1], normal[2], uv[0], uv[1]].map(f32::to_bits);
                    *slot = match known.entry((vertex, bits)) {
                        Entry::Occupied(entry) => *entry.get(),
                        Entry::Vacant(entry) => {
                            let position = to_vector(mesh.vertex_position[corner]);
                            let position = bound.to_world.transform_point3(position);
                            found.positions.push(position.to_array());
                            found.normals.push(normal);
                            if mesh.vertex_uv.exists {
                                found.uvs.push(uv);
                            }
                            found.joints.push(bound.joints);
                            found.weights.push(bound.weights);
                            *entry.insert(u32::try_from(found.positions.len() - 1).unwrap_or(0))
                        }
                    };
                }
                if is_mirrored {
                    own.swap(1, 2);
                }
                found.triangles.extend(own);
            }
        }
        found
    }
}

/// Return the largest influences of a skin on a vertex; None if there are none.
fn skinned(
    skin: &ufbx::SkinDeformer,
    vertex: usize,
    transforms: &[Option<(usize, DAffine3)>],
) -> Option<Bound> {
    let own = skin.vertices.get(vertex)?;
    let first = own.weight_begin as usize;
    let weights = skin.weights.get(first..first + own.num_weights as usize)?;
    let mut found: Vec<(f64, usize, DAffine3)> = weights
        .iter()
        .filter(|own| own.weight > 0.0)
        .filter_map(|own| {
            let (bone, transform) = (*transforms.get(own.cluster_index as usize)?)?;
            Some((own.weight, bone, transform))
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(MAX_INFLUENCES);
    let total: f64 = found.iter().map(|own| own.0).sum();
    if !total.is_normal() {
        return None;
    }
    let mut bound = Bound {
        to_world: DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO },
        joints: [0; MAX_INFLUENCES],
        weights: [0.0; MAX_INFLUENCES],
    };
    for (slot, (weight, bone, transform)) in found.into_iter().enumerate() {
        let share = weight / total;
        bound.to_world.matrix3 += transform.matrix3 * share;
        bound.to_world.translation += transform.translation * share;
        bound.joints[slot] = to_index(bone);
        bound.weights[slot] = share as f32;
    }
    Some(bound)
}

fn normal(mesh: &ufbx::Mesh, corner: usize, bound: &Bound) -> [f32; 3] {
    let given = to_vector(mesh.vertex_normal[corner]);
    let matrix = bound.to_world.matrix3;
    let turned = matrix.determinant().signum() * (matrix.inverse().transpose() * given);
    let unit = turned.try_normalize().or_else(|| given.try_normalize());
    unit.unwrap_or(DVec3::Y).as_vec3().to_array()
}

fn uv(mesh: &ufbx::Mesh, corner: usize) -> [f32; 2] {
    if !mesh.vertex_uv.exists {
        return [0.0; 2];
    }
    let uv = mesh.vertex_uv[corner];
    [uv.x as f32, uv.y as f32]
}

fn material(material: &ufbx::Material) -> Material {
    let (pbr, fbx) = (&material.pbr, &material.fbx);
    let texture = [&pbr.base_color, &fbx.diffuse_color]
        .into_iter()
        .filter(|map| map.texture_enabled)
        .find_map(|map| map.texture.as_ref())
        .map(|own| texture(own));
    let map = if pbr.base_color.has_value { &pbr.base_color } else { &fbx.diffuse_color };
    let factor = if pbr.base_factor.has_value { pbr.base_factor.value_vec4.x } else { 1.0 };
    let value = map.value_vec4;
    let color = if texture.is_some() || !map.has_value {
        [1.0; 3]
    } else {
        [value.x, value.y, value.z].map(|own| own * factor)
    };
    Material { name: material.element.name.to_string(), color, texture }
}

fn texture(texture: &ufbx::Texture) -> (String, Vec<u8>) {
    let file = texture
        .file_textures
        .first()
        .map_or(texture, |own| own.as_ref());
    let name =
        if file.relative_filename.is_empty() { &file.filename } else { &file.relative_filename };
    let embedded = file.video.as_ref().map(|video| video.content.as_ref());
    let content =
        if file.content.is_empty() { embedded.unwrap_or(&[]) } else { file.content.as_ref() };
    (name.to_string(), content.to_vec())
}

fn to_index(index: usize) -> i64 {
    i64::try_from(index).unwrap_or(i64::MAX)
}
