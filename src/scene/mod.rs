//! What exists in the world: clouds, objects, cameras, far fields, lamps, materials, pictures, places; and spherical harmonics, as which
//! light and what objects do with it are described.

pub mod camera;
pub mod cloud;
pub mod far_field;
pub mod harmonics;
pub mod lamp;
pub mod object;
pub mod picture;
pub mod placement;
pub mod surfaces;

pub use camera::Camera;
pub use cloud::Cloud;
pub use far_field::FarField;
pub use lamp::{Lamp, LampKind};
pub use object::{Material, Object, Primitive, Texture, TextureRef, Vertex};
pub use picture::Picture;
pub use placement::{Placement, Viewpoint};
pub use surfaces::{AlbedoFrom, Brush, Surfaces};
