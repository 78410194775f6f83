//! ONNX files, checked: one picture in, one of the same size out.

use std::path::Path;
use std::sync::Arc;

use tract_onnx::pb::tensor_proto::DataType;
use tract_onnx::pb::{ModelProto, TensorShapeProto, ValueInfoProto, tensor_shape_proto, type_proto};
use tract_onnx::prelude::{DatumType, Framework, InferenceFact, InferenceModelExt, IntoRunnable, TypedRunnableModel};

use crate::{Error, Result};

/// Height and width of a tile where the network leaves them open.
const TILE: usize = 256;
/// What a fixed height or width may be.
const SIZES: std::ops::RangeInclusive<usize> = 8..=4096;
/// What networks must be made for.
const EXPECTED: &str = "1x3xHxW";

/// A plan to run the network in `bytes` on tiles of the returned height and width.
///
/// # Errors
/// [`Error::File`] with `name` when it is no ONNX file, uses what the runtime lacks, or is made for anything but one
/// 1x3xHxW picture in and one of the same size out.
pub(super) fn load(name: &Path, bytes: &[u8]) -> Result<(Arc<TypedRunnableModel>, [usize; 2])> {
    // The runtime takes names and sizes in the file for granted in places. A panic there is about the file as well.
    let plan = std::panic::catch_unwind(|| plan(bytes));
    plan.unwrap_or_else(|_| Err("it is damaged: the ONNX runtime gave up on it".to_owned()))
        .map_err(|problem| Error::file(name, problem))
}

/// An error of the runtime with its causes.
pub(super) fn chain(error: &tract_onnx::prelude::TractError) -> String {
    format!("{error:#}")
}

fn plan(bytes: &[u8]) -> Result<(Arc<TypedRunnableModel>, [usize; 2]), String> {
    let onnx = tract_onnx::onnx();
    let proto =
        onnx.proto_model_for_read(&mut &*bytes).map_err(|error| format!("not an ONNX file: {}", chain(&error)))?;
    let [height, width] = picture_size(&proto)?;
    let unusable = |error| format!("the ONNX runtime cannot use it: {}", chain(&error));
    let fact = InferenceFact::dt_shape(DatumType::F32, [1, 3, height, width]);
    let model = onnx
        .model_for_proto_model(&proto)
        .and_then(|model| {
            model.with_input_fact(0, fact)?.with_output_fact(0, InferenceFact::default())?.into_optimized()
        })
        .map_err(unusable)?;
    let output = model.output_fact(0).map_err(unusable)?;
    let shape: Vec<String> = output.shape.iter().map(|d| d.to_string()).collect();
    let expected = format!("1x3x{height}x{width}");
    if shape.join("x") != expected || output.datum_type != DatumType::F32 {
        let found = format!("{} ({:?})", shape.join("x"), output.datum_type);
        return Err(format!("its output is {found} for an input of {expected}; expected {expected} (F32)"));
    }
    Ok((model.into_runnable().map_err(unusable)?, [height, width]))
}

/// Height and width of the pictures that the network takes: its own, or those of a tile.
fn picture_size(proto: &ModelProto) -> Result<[usize; 2], String> {
    let graph = proto.graph.as_ref().ok_or("not an ONNX file: it holds no graph")?;
    // Old files list their weights among the inputs.
    let is_weight = |input: &ValueInfoProto| graph.initializer.iter().any(|weight| weight.name == input.name);
    let inputs: Vec<&ValueInfoProto> = graph.input.iter().filter(|input| !is_weight(input)).collect();
    let ([input], [output]) = (&*inputs, &*graph.output) else {
        let (inputs, outputs) = (inputs.len(), graph.output.len());
        return Err(format!("it has {inputs} inputs and {outputs} outputs; expected one {EXPECTED} picture each"));
    };
    if !graph.node.iter().any(|node| node.output.contains(&output.name)) {
        return Err(format!("nothing makes its output {:?}", output.name));
    }
    let Some(type_proto::Value::TensorType(tensor)) = input.r#type.as_ref().and_then(|kind| kind.value.as_ref()) else {
        return Err(format!("its input {:?} is no tensor; expected {EXPECTED}", input.name));
    };
    if tensor.elem_type != DataType::Float as i32 {
        let found = DataType::try_from(tensor.elem_type).map_or("of an unknown type", |kind| kind.as_str_name());
        return Err(format!("its input {:?} is {found}; expected FLOAT", input.name));
    }
    let shape =
        tensor.shape.as_ref().ok_or_else(|| format!("its input {:?} has no shape; expected {EXPECTED}", input.name))?;
    let wrong = || format!("its input {:?} is {}; expected {EXPECTED}", input.name, written(shape));
    let [batch, channels, height, width] = &*fixed(shape) else { return Err(wrong()) };
    if batch.is_some_and(|n| n != 1) || channels.is_some_and(|n| n != 3) {
        return Err(wrong());
    }
    let side = |size: Option<i64>| match size.map(usize::try_from) {
        None => Ok(TILE),
        Some(Ok(size)) if SIZES.contains(&size) => Ok(size),
        Some(_) => Err(format!("{} with H and W of {} to {}", wrong(), SIZES.start(), SIZES.end())),
    };
    Ok([side(*height)?, side(*width)?])
}

/// Dimensions of a shape; `None` for those that the network leaves open.
fn fixed(shape: &TensorShapeProto) -> Vec<Option<i64>> {
    let size = |dim: &tensor_shape_proto::Dimension| match &dim.value {
        Some(tensor_shape_proto::dimension::Value::DimValue(size)) if *size >= 0 => Some(*size),
        _ => None,
    };
    shape.dim.iter().map(size).collect()
}

/// A shape as people write it, with `?` for what is open.
fn written(shape: &TensorShapeProto) -> String {
    let dims: Vec<String> = fixed(shape).iter().map(|size| size.map_or("?".to_owned(), |n| n.to_string())).collect();
    if dims.is_empty() { "a single number".to_owned() } else { dims.join("x") }
}
