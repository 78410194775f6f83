//! The G-buffer: position, normal and material of the object at every pixel's centre (Sabbadin 2019, 5.2).

use std::sync::Arc;

use ash::vk;
use bytemuck::{Pod, Zeroable};
use glam::Mat4;
use rayon::prelude::*;

use crate::Result;
use crate::gpu::graphics::{GraphicsInfo, graphics_pipeline};
use crate::gpu::memory::ImageInfo;
use crate::gpu::pipeline::{DescriptorSet, Layout, Pipeline, Sampler};
use crate::gpu::{Bindings, Buffer, Constant, Context, Image, Recorder, Use};
use crate::scene::{Camera, Material, Object, Texture, TextureRef, Vertex};

/// Push constants (`glsl/shared/draw.glsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Draw {
    /// World to clip space.
    pub clip_from_world: [[f32; 4]; 4],
    /// Linear base colour and metallic.
    pub base_color_metallic: [f32; 4],
    /// Emitted radiance and roughness.
    pub emissive_roughness: [f32; 4],
    /// Eye, world space.
    pub eye: [f32; 3],
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Fragments with less alpha are not drawn.
    pub alpha_cutoff: f32,
    /// Disney's specular.
    pub specular: f32,
    /// GGX alpha below which lobes may have buffers of their own.
    pub sharp_alpha: f32,
    /// Which textures there are: bit 0 base colour, 1 metallic-roughness, 2 normal, 3 emissive.
    pub textures: u32,
}

/// A rectangle of the image, in pixels from the upper left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

/// The images of one region.
pub struct GBuffer {
    /// World position; w is 1 where something is covered.
    pub position: Image,
    /// World normal; w is Disney's specular.
    pub normal: Image,
    /// Base colour and metallic.
    pub base_metallic: Image,
    /// Emitted radiance and roughness.
    pub emissive_roughness: Image,
    /// Irradiance, and what of the surround is seen, where the pass writes it.
    pub irradiance: Option<Image>,
    depth: Image,
}

/// Bytes of a G-buffer a pixel.
pub const BYTES_PER_PIXEL: u64 = 16 + 16 + 8 + 8 + 4;
/// Bytes more with irradiance.
pub const IRRADIANCE_BYTES_PER_PIXEL: u64 = 16;

const IRRADIANCE_FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

impl GBuffer {
    /// Images for a region.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn new(context: &Arc<Context>, width: u32, height: u32) -> Result<Self> {
        let color = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
        let image =
            |name, format, usage| Image::new(context, ImageInfo { name, width, height, levels: 1, format, usage });
        Ok(Self {
            position: image("G-buffer position", vk::Format::R32G32B32A32_SFLOAT, color)?,
            normal: image("G-buffer normal", vk::Format::R32G32B32A32_SFLOAT, color)?,
            base_metallic: image("G-buffer base colour", vk::Format::R16G16B16A16_SFLOAT, color)?,
            emissive_roughness: image("G-buffer emissive", vk::Format::R16G16B16A16_SFLOAT, color)?,
            irradiance: None,
            depth: image("G-buffer depth", vk::Format::D32_SFLOAT, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT)?,
        })
    }

    /// The same with an image for the irradiance.
    ///
    /// # Errors
    /// When they do not fit the device.
    pub fn with_irradiance(context: &Arc<Context>, width: u32, height: u32) -> Result<Self> {
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
        let info =
            ImageInfo { name: "G-buffer irradiance", width, height, levels: 1, format: IRRADIANCE_FORMAT, usage };
        Ok(Self { irradiance: Some(Image::new(context, info)?), ..Self::new(context, width, height)? })
    }

    fn colors(&self) -> impl Iterator<Item = &Image> {
        [&self.position, &self.normal, &self.base_metallic, &self.emissive_roughness]
            .into_iter()
            .chain(&self.irradiance)
    }
}

/// An object on the device.
struct GpuObject {
    vertices: Buffer,
    indices: Buffer,
    draws: Vec<(std::ops::Range<u32>, Draw, DescriptorSet)>,
    _textures: Vec<Image>,
}

/// The pass, with the object that it draws.
pub struct GBufferPass {
    pipeline: Pipeline,
    object: GpuObject,
    _sampler: Sampler,
}

impl GBufferPass {
    /// Uploads the object, which is in world space, and makes the pipeline.
    ///
    /// # Errors
    /// When the object does not fit the device.
    pub fn new(context: &Arc<Context>, object: &Object) -> Result<Self> {
        Self::with_shaders(
            context,
            object,
            ["gbuffer/gbuffer.vert", "gbuffer/gbuffer.frag"],
            &[],
            &Bindings::new(),
            &[],
        )
    }

    /// The same for a pass that writes the irradiance too, which it takes from `bindings`: that of the vertices, and the
    /// light.
    ///
    /// # Errors
    /// As [`GBufferPass::new`].
    pub(super) fn with_irradiance(
        context: &Arc<Context>,
        object: &Object,
        bindings: &Bindings<'_>,
        constants: &[Constant],
    ) -> Result<Self> {
        let shaders = ["probe_object/surface.vert", "probe_object/surface.frag"];
        Self::with_shaders(context, object, shaders, &[IRRADIANCE_FORMAT], bindings, constants)
    }

    fn with_shaders(
        context: &Arc<Context>,
        object: &Object,
        shaders: [&str; 2],
        more: &[vk::Format],
        bindings: &Bindings<'_>,
        constants: &[Constant],
    ) -> Result<Self> {
        let (four, half) = (vk::Format::R32G32B32A32_SFLOAT, vk::Format::R16G16B16A16_SFLOAT);
        let pipeline = graphics_pipeline(
            context,
            &GraphicsInfo {
                name: "gbuffer",
                shaders,
                constants,
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                stride: size_of::<Vertex>(),
                attributes: &[
                    (vk::Format::R32G32B32_SFLOAT, std::mem::offset_of!(Vertex, position)),
                    (vk::Format::R32G32B32_SFLOAT, std::mem::offset_of!(Vertex, normal)),
                    (four, std::mem::offset_of!(Vertex, tangent)),
                    (vk::Format::R32G32_SFLOAT, std::mem::offset_of!(Vertex, uv)),
                ],
                colors: &[&[four, four, half, half], more].concat(),
                nearer: vk::CompareOp::LESS,
            },
        )?;
        let sampler = Sampler::new(context, vk::Filter::LINEAR, vk::SamplerAddressMode::REPEAT)?;
        let object = GpuObject::new(context, object, &pipeline.layout, &sampler, bindings)?;
        Ok(Self { pipeline, object, _sampler: sampler })
    }

    /// Moves the object: the same vertices, in their order, at other places of world space.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for another number of vertices; Vulkan's own errors.
    pub fn place(&self, vertices: &[Vertex]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(vertices);
        if bytes.len() as u64 > self.object.vertices.size {
            return Err(crate::Error::Argument("an object that moves keeps its vertices".into()));
        }
        self.object.vertices.upload(bytes)
    }

    /// Draws the object into the G-buffer of a region of a `width` x `height` image, and leaves its images for
    /// sampling.
    pub fn record(&self, recorder: &mut Recorder, target: &GBuffer, camera: &Camera, view: View) {
        let context = recorder.context().clone();
        recorder.pass("gbuffer", |device, commands| {
            for image in target.colors() {
                image.transition(device, commands, Use::Undefined, Use::ColorTarget);
            }
            target.depth.transition(device, commands, Use::Undefined, Use::DepthTarget);
            let attachment = |image: &Image, layout, clear| {
                vk::RenderingAttachmentInfo::default()
                    .image_view(image.view)
                    .image_layout(layout)
                    .load_op(vk::AttachmentLoadOp::CLEAR)
                    .store_op(vk::AttachmentStoreOp::STORE)
                    .clear_value(clear)
            };
            let black = vk::ClearValue { color: vk::ClearColorValue { float32: [0.0; 4] } };
            let far = vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth: 1.0, stencil: 0 } };
            let colors: Vec<_> = target
                .colors()
                .map(|image| attachment(image, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, black))
                .collect();
            let depth = attachment(&target.depth, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL, far);
            let extent = vk::Extent2D { width: target.position.width, height: target.position.height };
            let info = vk::RenderingInfo::default()
                .render_area(vk::Rect2D { offset: vk::Offset2D::default(), extent })
                .layer_count(1)
                .color_attachments(&colors)
                .depth_attachment(&depth);
            context.begin_rendering(commands, &info);
            self.draw(device, commands, camera, view, extent);
            context.end_rendering(commands);
            for image in target.colors() {
                image.transition(device, commands, Use::ColorTarget, Use::SampledRead);
            }
        });
        let indices = self.object.draws.iter().map(|(range, _, _)| u64::from(range.end - range.start));
        recorder.count("triangles", indices.sum::<u64>() / 3);
    }

    fn draw(
        &self,
        device: &ash::Device,
        commands: vk::CommandBuffer,
        camera: &Camera,
        view: View,
        extent: vk::Extent2D,
    ) {
        // The whole image's viewport, shifted so that the region's corner is at the origin: regions of an image show
        // what the whole would.
        let viewport = vk::Viewport {
            x: -(view.region.x as f32),
            y: -(view.region.y as f32),
            width: view.width as f32,
            height: view.height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let clip_from_world =
            camera.clip_from_world(view.width as f32 / view.height as f32, view.near, view.far).to_cols_array_2d();
        // SAFETY: all handles are live and `commands` records inside a rendering instance with these attachments.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, self.pipeline.handle);
            device.cmd_set_viewport(commands, 0, &[viewport]);
            device.cmd_set_scissor(commands, 0, &[vk::Rect2D { offset: vk::Offset2D::default(), extent }]);
            device.cmd_bind_vertex_buffers(commands, 0, &[self.object.vertices.handle], &[0]);
            device.cmd_bind_index_buffer(commands, self.object.indices.handle, 0, vk::IndexType::UINT32);
            for (range, draw, set) in &self.object.draws {
                device.cmd_bind_descriptor_sets(
                    commands,
                    vk::PipelineBindPoint::GRAPHICS,
                    self.pipeline.layout.handle,
                    0,
                    &[set.handle],
                    &[],
                );
                self.pipeline.layout.push(
                    commands,
                    &Draw { clip_from_world, eye: camera.from.into(), sharp_alpha: view.sharp_alpha, ..*draw },
                );
                device.cmd_draw_indexed(commands, range.end - range.start, 1, range.start, 0, 0);
            }
        }
    }
}

/// What part of which image is drawn, and the depth range.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Width of the whole image.
    pub width: u32,
    /// Height of the whole image.
    pub height: u32,
    /// The part that is drawn.
    pub region: Rect,
    /// Nearest depth, metres.
    pub near: f32,
    /// Farthest depth, metres.
    pub far: f32,
    /// GGX alpha below which lobes may have buffers of their own; 0 for none.
    pub sharp_alpha: f32,
}

impl GpuObject {
    fn new(
        context: &Arc<Context>,
        object: &Object,
        layout: &Layout,
        sampler: &Sampler,
        bindings: &Bindings<'_>,
    ) -> Result<Self> {
        let mut textures = object
            .textures
            .par_iter()
            .map(mip_levels)
            .collect::<Vec<_>>()
            .into_iter()
            .zip(&object.textures)
            .map(|(levels, texture)| upload(context, texture, &levels))
            .collect::<Result<Vec<_>>>()?;
        // Stands in for textures that a material does not have; the shader does not look at it.
        let white = Texture { width: 1, height: 1, srgb: false, rgba: vec![255; 4] };
        textures.push(upload(context, &white, std::slice::from_ref(&white.rgba))?);
        let mut draws = Vec::new();
        for primitive in &object.primitives {
            let material = &object.materials[primitive.material];
            let image = |reference: Option<TextureRef>| &textures[reference.map_or(textures.len() - 1, |r| r.texture)];
            let set = layout.bind(
                &bindings
                    .clone()
                    .sampled("base_color_map", image(material.base_color_texture), sampler.handle)
                    .sampled("metallic_roughness_map", image(material.metallic_roughness_texture), sampler.handle)
                    .sampled("normal_map", image(material.normal_texture), sampler.handle)
                    .sampled("emissive_map", image(material.emissive_texture), sampler.handle),
            )?;
            draws.push((primitive.indices.clone(), draw_of(material), set));
        }
        Ok(Self {
            vertices: Buffer::from_slice(context, "object vertices", &object.vertices)?,
            indices: Buffer::from_slice(context, "object indices", &object.indices)?,
            draws,
            _textures: textures,
        })
    }
}

fn draw_of(material: &Material) -> Draw {
    let bit = |texture: Option<TextureRef>, bit: u32| u32::from(texture.is_some()) << bit;
    Draw {
        clip_from_world: Mat4::IDENTITY.to_cols_array_2d(),
        base_color_metallic: material.base_color.extend(material.metallic).into(),
        emissive_roughness: material.emissive.extend(material.roughness).into(),
        eye: [0.0; 3],
        normal_scale: material.normal_scale,
        alpha_cutoff: material.alpha_cutoff,
        specular: material.specular,
        sharp_alpha: 0.0,
        textures: bit(material.base_color_texture, 0)
            | bit(material.metallic_roughness_texture, 1)
            | bit(material.normal_texture, 2)
            | bit(material.emissive_texture, 3),
    }
}

fn upload(context: &Arc<Context>, texture: &Texture, levels: &[Vec<u8>]) -> Result<Image> {
    let info = ImageInfo {
        name: "object texture",
        width: texture.width,
        height: texture.height,
        levels: levels.len() as u32,
        format: if texture.srgb { vk::Format::R8G8B8A8_SRGB } else { vk::Format::R8G8B8A8_UNORM },
        usage: vk::ImageUsageFlags::SAMPLED,
    };
    let slices: Vec<&[u8]> = levels.iter().map(Vec::as_slice).collect();
    Image::with_contents(context, info, &slices)
}

/// Level 0 and all smaller ones, each averaged from the one above, sRGB values as linear light.
fn mip_levels(texture: &Texture) -> Vec<Vec<u8>> {
    let to_linear: Vec<f32> = (0..=255_u8)
        .map(|byte| {
            let value = f32::from(byte) / 255.0;
            if texture.srgb { value.powf(2.2) } else { value }
        })
        .collect();
    let to_byte = |value: f32| {
        let encoded = if texture.srgb { value.powf(1.0 / 2.2) } else { value };
        (encoded * 255.0).round() as u8
    };
    let (mut width, mut height) = (texture.width as usize, texture.height as usize);
    let mut levels = vec![texture.rgba.clone()];
    while width > 1 || height > 1 {
        let above = &levels[levels.len() - 1];
        let (next_width, next_height) = ((width / 2).max(1), (height / 2).max(1));
        let mut level = Vec::with_capacity(4 * next_width * next_height);
        for y in 0..next_height {
            for x in 0..next_width {
                for channel in 0..4 {
                    let texel = |dx: usize, dy: usize| {
                        let (x, y) = ((2 * x + dx).min(width - 1), (2 * y + dy).min(height - 1));
                        above[4 * (y * width + x) + channel]
                    };
                    let four = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
                    level.push(if channel == 3 {
                        (four.iter().map(|b| u32::from(*b)).sum::<u32>().div_ceil(4)) as u8
                    } else {
                        to_byte(four.iter().map(|b| to_linear[usize::from(*b)]).sum::<f32>() / 4.0)
                    });
                }
            }
        }
        levels.push(level);
        (width, height) = (next_width, next_height);
    }
    levels
}
