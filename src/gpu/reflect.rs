//! What a shader asks of the host, read from its SPIR-V: descriptor bindings by name, the push constant block with
//! the offset of every member, workgroup size, and the layout of transform feedback.

use std::collections::HashMap;

use ash::vk;
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Dim, ExecutionModel, Op, StorageClass, Word};

use crate::{Error, Result};

/// One descriptor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Name of the block type (buffers) or variable (images) in the GLSL.
    pub name: String,
    /// Binding number in set 0.
    pub binding: u32,
    /// Kind of descriptor.
    pub kind: vk::DescriptorType,
}

/// One member of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name in the GLSL.
    pub name: String,
    /// Byte offset.
    pub offset: u32,
    /// Size in bytes.
    pub size: u32,
}

/// One storage buffer's block, as far as its members have a size: an unbounded array at its end has size 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Name of the block type.
    pub name: String,
    /// Members in order.
    pub members: Vec<Member>,
}

/// One transform feedback output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FeedbackOutput {
    /// Name in the GLSL.
    pub name: String,
    /// Vertex stream.
    pub stream: u32,
    /// Feedback buffer.
    pub buffer: u32,
    /// Bytes between vertices.
    pub stride: u32,
    /// Byte offset in a vertex.
    pub offset: u32,
    /// Size in bytes.
    pub size: u32,
}

/// Everything that relume needs to know about an entry point.
#[derive(Clone, Debug)]
pub struct Reflection {
    /// Stage of the entry point.
    pub stage: vk::ShaderStageFlags,
    /// Descriptors of set 0, by binding number.
    pub bindings: Vec<Binding>,
    /// Storage buffers.
    pub blocks: Vec<Block>,
    /// Members of the push constant block; empty without one.
    pub push_constants: Vec<Member>,
    /// Invocations of a workgroup along x (compute).
    pub workgroup: u32,
    /// Transform feedback outputs (geometry).
    pub feedback: Vec<FeedbackOutput>,
}

impl Reflection {
    /// Size of the push constant block, bytes.
    pub fn push_constant_size(&self) -> u32 {
        self.push_constants.iter().map(|m| m.offset + m.size).max().unwrap_or(0)
    }

    /// Reads a module of one entry point.
    ///
    /// # Errors
    /// When the words are not a SPIR-V module that relume's shaders could be.
    pub fn of(words: &[u32]) -> Result<Self> {
        let module = rspirv::dr::load_words(words)
            .map_err(|e| Error::Argument(format!("a shader is not readable SPIR-V: {e}")))?;
        Reader::new(&module).reflection()
    }
}

struct Reader<'a> {
    module: &'a Module,
    types: HashMap<Word, &'a Instruction>,
    names: HashMap<Word, &'a str>,
    member_names: HashMap<(Word, u32), &'a str>,
}

impl<'a> Reader<'a> {
    fn new(module: &'a Module) -> Self {
        let types = module.types_global_values.iter().filter_map(|i| i.result_id.map(|id| (id, i))).collect();
        let mut names = HashMap::new();
        let mut member_names = HashMap::new();
        for name in &module.debug_names {
            match (name.class.opcode, name.operands.as_slice()) {
                (Op::Name, [Operand::IdRef(id), Operand::LiteralString(text)]) => {
                    names.insert(*id, text.as_str());
                }
                (Op::MemberName, [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::LiteralString(text)]) => {
                    member_names.insert((*id, *member), text.as_str());
                }
                _ => {}
            }
        }
        Self { module, types, names, member_names }
    }

    fn decoration(&self, target: Word, wanted: Decoration) -> Option<u32> {
        self.module.annotations.iter().find_map(|i| match i.operands.as_slice() {
            [Operand::IdRef(id), Operand::Decoration(d), Operand::LiteralBit32(value)]
                if i.class.opcode == Op::Decorate && *id == target && *d == wanted =>
            {
                Some(*value)
            }
            _ => None,
        })
    }

    fn member_decoration(&self, target: Word, member: u32, wanted: Decoration) -> Option<u32> {
        self.module.annotations.iter().find_map(|i| match i.operands.as_slice() {
            [Operand::IdRef(id), Operand::LiteralBit32(m), Operand::Decoration(d), Operand::LiteralBit32(value)]
                if i.class.opcode == Op::MemberDecorate && *id == target && *m == member && *d == wanted =>
            {
                Some(*value)
            }
            _ => None,
        })
    }

    fn operand_id(instruction: &Instruction, index: usize) -> Option<Word> {
        match instruction.operands.get(index) {
            Some(Operand::IdRef(id)) => Some(*id),
            _ => None,
        }
    }

    fn literal(instruction: &Instruction, index: usize) -> Option<u32> {
        match instruction.operands.get(index) {
            Some(Operand::LiteralBit32(value)) => Some(*value),
            _ => None,
        }
    }

    /// Bytes of a numeric type as it lies in a block, padding of matrices apart; 0 for anything without a size.
    fn size_of(&self, id: Word) -> u32 {
        let Some(kind) = self.types.get(&id) else { return 0 };
        match kind.class.opcode {
            Op::TypeInt | Op::TypeFloat => Self::literal(kind, 0).unwrap_or(0) / 8,
            Op::TypeVector => {
                Self::operand_id(kind, 0).map_or(0, |e| self.size_of(e)) * Self::literal(kind, 1).unwrap_or(0)
            }
            // Columns of a mat4 are 16 bytes apart; relume has no others.
            Op::TypeMatrix => 16 * Self::literal(kind, 1).unwrap_or(0),
            _ => 0,
        }
    }

    fn reflection(&self) -> Result<Reflection> {
        let entry =
            self.module.entry_points.first().ok_or_else(|| Error::Argument("a shader has no entry point".into()))?;
        let stage = match entry.operands.first() {
            Some(Operand::ExecutionModel(ExecutionModel::Vertex)) => vk::ShaderStageFlags::VERTEX,
            Some(Operand::ExecutionModel(ExecutionModel::Geometry)) => vk::ShaderStageFlags::GEOMETRY,
            Some(Operand::ExecutionModel(ExecutionModel::Fragment)) => vk::ShaderStageFlags::FRAGMENT,
            Some(Operand::ExecutionModel(ExecutionModel::GLCompute)) => vk::ShaderStageFlags::COMPUTE,
            other => return Err(Error::Argument(format!("a shader's stage is not supported: {other:?}"))),
        };
        let mut bindings = Vec::new();
        let mut blocks = Vec::new();
        let mut push_constants = Vec::new();
        let mut feedback = Vec::new();
        for variable in self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable) {
            let (Some(id), Some(pointer), Some(Operand::StorageClass(class))) =
                (variable.result_id, variable.result_type, variable.operands.first())
            else {
                continue;
            };
            let Some(pointee) = self.types.get(&pointer).and_then(|p| Self::operand_id(p, 1)) else { continue };
            match class {
                StorageClass::PushConstant => push_constants = self.members(pointee),
                StorageClass::StorageBuffer | StorageClass::Uniform | StorageClass::UniformConstant => {
                    bindings.extend(self.binding(id, pointee, *class));
                    if let (StorageClass::StorageBuffer, Some(name)) = (class, self.names.get(&pointee)) {
                        blocks.push(Block { name: (*name).to_owned(), members: self.members(pointee) });
                    }
                }
                StorageClass::Output => feedback.extend(self.feedback_output(id, pointee)),
                _ => {}
            }
        }
        bindings.sort_by_key(|b: &Binding| b.binding);
        Ok(Reflection { stage, bindings, blocks, push_constants, workgroup: self.workgroup(), feedback })
    }

    fn binding(&self, id: Word, pointee: Word, class: StorageClass) -> Option<Binding> {
        let binding = self.decoration(id, Decoration::Binding)?;
        let kind = self.types.get(&pointee)?;
        let (named, kind) = match (class, kind.class.opcode) {
            (StorageClass::StorageBuffer, _) => (pointee, vk::DescriptorType::STORAGE_BUFFER),
            (StorageClass::Uniform, _) => (pointee, vk::DescriptorType::UNIFORM_BUFFER),
            (_, Op::TypeSampledImage) if self.is_texel_buffer(kind) => (id, vk::DescriptorType::UNIFORM_TEXEL_BUFFER),
            (_, Op::TypeSampledImage) => (id, vk::DescriptorType::COMBINED_IMAGE_SAMPLER),
            (_, Op::TypeImage) if kind.operands.get(1) == Some(&Operand::Dim(Dim::DimBuffer)) => {
                (id, vk::DescriptorType::STORAGE_TEXEL_BUFFER)
            }
            (_, Op::TypeImage) => (id, vk::DescriptorType::STORAGE_IMAGE),
            _ => return None,
        };
        Some(Binding { name: (*self.names.get(&named)?).to_owned(), binding, kind })
    }

    /// Whether a sampled image is a `samplerBuffer`.
    fn is_texel_buffer(&self, sampled: &Instruction) -> bool {
        let image = Self::operand_id(sampled, 0).and_then(|id| self.types.get(&id));
        image.is_some_and(|i| i.operands.get(1) == Some(&Operand::Dim(Dim::DimBuffer)))
    }

    fn members(&self, block: Word) -> Vec<Member> {
        let Some(kind) = self.types.get(&block) else { return Vec::new() };
        (0..kind.operands.len())
            .filter_map(|i| {
                let index = i as u32;
                Some(Member {
                    name: (*self.member_names.get(&(block, index))?).to_owned(),
                    offset: self.member_decoration(block, index, Decoration::Offset)?,
                    size: self.size_of(Self::operand_id(kind, i)?),
                })
            })
            .collect()
    }

    fn feedback_output(&self, id: Word, pointee: Word) -> Option<FeedbackOutput> {
        // gl_PerVertex carries a buffer and a stride too, but no offset: nothing of it is captured.
        Some(FeedbackOutput {
            offset: self.decoration(id, Decoration::Offset)?,
            buffer: self.decoration(id, Decoration::XfbBuffer)?,
            stride: self.decoration(id, Decoration::XfbStride)?,
            stream: self.decoration(id, Decoration::Stream).unwrap_or(0),
            name: (*self.names.get(&id)?).to_owned(),
            size: self.size_of(pointee),
        })
    }

    fn workgroup(&self) -> u32 {
        self.module
            .execution_modes
            .iter()
            .find_map(|mode| match mode.operands.as_slice() {
                [_, Operand::ExecutionMode(rspirv::spirv::ExecutionMode::LocalSize), Operand::LiteralBit32(x), ..] => {
                    Some(*x)
                }
                _ => None,
            })
            .unwrap_or(1)
    }
}
