//! What crosses the border between Rust and GLSL lies where both sides think it does, and data flows downwards only.

use std::mem::offset_of;
use std::path::{Path, PathBuf};

use relume::gpu::reflect::{Member, Reflection};
use relume::gpu::shaders;
use relume::passes::bin::Counts;
use relume::passes::gbuffer::Draw;
use relume::passes::lamp_view::LampPass;
use relume::passes::points::PointView;
use relume::passes::probe_light::ProbeConstants;
use relume::passes::probe_object::{ShadeConstants, TransferConstants};
use relume::passes::rasterise::RasterCounts;
use relume::passes::traverse::PAIR_BYTES;
use relume::passes::{Gather, ImageRegion, Traversal};

/// A Rust struct as the shaders should see it.
struct Struct {
    name: &'static str,
    size: usize,
    members: Vec<Member>,
}

/// Every member of a Rust struct with its GLSL name, offset and size; a struct with a member that is not listed does
/// not compile.
macro_rules! members {
    ($type:ident { $($field:ident as $glsl:literal),* $(,)? }) => {{
        let whole: $type = bytemuck::Zeroable::zeroed();
        let $type { $($field),* } = whole;
        Struct {
            name: stringify!($type),
            size: size_of::<$type>(),
            members: vec![$(Member {
                name: $glsl.to_owned(),
                offset: offset_of!($type, $field) as u32,
                size: size_of_val(&$field) as u32,
            }),*],
        }
    }};
}

fn push_constants() -> [Struct; 9] {
    [
        members!(Traversal {
            pixels as "pixels",
            stop_sin2 as "stop_sin2",
            switch_sin2 as "switch_sin2",
            capacity as "capacity",
            list_capacity as "list_capacity",
        }),
        members!(Gather {
            pixels as "pixels",
            first_entry as "first_entry",
            entry_count as "entry_count",
            color_scale as "color_scale",
            eye as "eye",
            coverage_limit as "coverage_limit",
            width as "width",
            height as "height",
            tiles_x as "tiles_x",
            material_parameter as "material_parameter",
            far_field_height as "far_field_height",
            stop_sin2 as "stop_sin2",
            last_round as "last_round",
            typical as "typical",
            sharp_alpha as "sharp_alpha",
            radiance_scale as "radiance_scale",
            store_columns as "store_columns",
        }),
        members!(ImageRegion { width as "width", height as "height", tiles_x as "tiles_x", pixels as "pixels" }),
        members!(Draw {
            clip_from_world as "clip_from_world",
            base_color_metallic as "base_color_metallic",
            emissive_roughness as "emissive_roughness",
            eye as "eye",
            normal_scale as "normal_scale",
            alpha_cutoff as "alpha_cutoff",
            specular as "specular",
            sharp_alpha as "sharp_alpha",
            textures as "textures",
        }),
        members!(PointView {
            eye as "eye",
            focal as "focal",
            right as "right",
            near as "near",
            down as "down",
            spacing as "spacing",
            forward as "forward",
            width as "width",
            height as "height",
            level as "level",
            level_width as "level_width",
            level_height as "level_height",
            source as "source",
            target as "target",
            first as "first",
            count as "count",
            display as "display",
            levels as "levels",
        }),
        members!(ProbeConstants {
            width as "width",
            height as "height",
            first as "first",
            target_width as "target_width",
            target_height as "target_height",
            target_first as "target_first",
            rows as "rows",
            groups as "groups",
            keep as "keep",
        }),
        members!(TransferConstants { vertices as "vertices", invocations as "invocations" }),
        members!(ShadeConstants {
            eye as "eye",
            width as "width",
            height as "height",
            material_parameter as "material_parameter",
            sharp_alpha as "sharp_alpha",
            mirror as "mirror",
        }),
        members!(LampPass {
            eye as "eye",
            focal as "focal",
            right as "right",
            width as "width",
            down as "down",
            height as "height",
            forward as "forward",
            vpls as "vpls",
            views as "views",
            view as "view",
            light_size as "light_size",
            side as "side",
            ism_size as "ism_size",
            level as "level",
            interleave as "interleave",
            bounce as "bounce",
            first as "first",
            count as "count",
            base as "base",
            points as "points",
            offset as "offset",
            spread as "spread",
            material as "material",
        }),
    ]
}

fn buffers() -> [Struct; 2] {
    [
        members!(Counts {
            handed as "handed_count",
            cut as "cut_count",
            visited as "visited_count",
            taken as "taken",
            placed as "placed",
        }),
        members!(RasterCounts {
            unfinished as "unfinished_count",
            reserved as "reserved",
            offered as "offered_count",
            drawn as "drawn_count",
            visited as "visited_count",
        }),
    ]
}

fn reflections() -> Vec<(&'static str, Reflection)> {
    let reflect = |name| Reflection::of(&shaders::spirv(name).expect("a known name")).expect("readable SPIR-V");
    shaders::names().map(|name| (name, reflect(name))).collect()
}

#[test]
fn push_constants_lie_alike_on_both_sides() {
    let structs = push_constants();
    let mut seen = [0; 9];
    for (shader, reflection) in reflections() {
        let block = &reflection.push_constants;
        if block.is_empty() {
            continue;
        }
        let at = structs.iter().position(|s| s.members == *block);
        let at = at.unwrap_or_else(|| panic!("{shader} has a push constant block that no struct matches: {block:#?}"));
        assert_eq!(structs[at].size, reflection.push_constant_size() as usize, "{shader}: {}", structs[at].name);
        seen[at] += 1;
    }
    for (Struct { name, .. }, count) in structs.iter().zip(seen) {
        assert!(count > 0, "no shader has the push constants {name}");
    }
}

#[test]
fn the_shaders_that_are_expected_have_push_constants() {
    // An empty block passes the comparison above. These use no constant: they hand on what they get, or size
    // lists.
    let without: Vec<&str> =
        reflections().into_iter().filter(|(_, r)| r.push_constants.is_empty()).map(|(name, _)| name).collect();
    assert_eq!(without, ["bin/place.comp", "points/points.frag", "traverse/traverse.vert"]);
}

#[test]
fn buffers_lie_alike_on_both_sides() {
    let structs = buffers();
    let mut seen = [0; 2];
    for (shader, reflection) in reflections() {
        for block in &reflection.blocks {
            let Some(at) = structs.iter().position(|s| s.name == block.name) else { continue };
            assert_eq!(structs[at].members, block.members, "{shader}: {}", block.name);
            let end = block.members.iter().map(|m| m.offset + m.size).max().expect("members");
            assert_eq!(structs[at].size, end as usize, "{shader}: {}", block.name);
            seen[at] += 1;
        }
    }
    // Refinement and the sort count; visibility, coverage, splat and trace rasterise.
    assert!(seen[0] >= 5 && seen[1] >= 4, "{seen:?}");
}

#[test]
fn arguments_of_an_indirect_dispatch_are_what_vulkan_reads() {
    let reflection = Reflection::of(&shaders::spirv("bin/prepare.comp").expect("the shader")).expect("SPIR-V");
    let offset = |block: &str| {
        let found = reflection.blocks.iter().find(|b| b.name == block).expect("the block");
        found.members.iter().map(|m| m.offset).collect::<Vec<_>>()
    };
    assert_eq!(offset("Arguments"), [0]);
    assert_eq!(offset("FeedbackCounter"), [0]);
}

#[test]
fn feedback_writes_pairs_as_the_host_lays_them_out() {
    for (shader, reflection) in reflections() {
        if shader != "traverse/traverse.geom" {
            assert!(reflection.feedback.is_empty(), "{shader} has feedback outputs that nobody captures");
            continue;
        }
        let mut outputs = reflection.feedback;
        outputs.sort_by_key(|o| o.stream);
        assert_eq!(outputs.len(), 2, "{outputs:?}");
        for (stream, (output, name)) in (0..).zip(outputs.iter().zip(["next_pair", "done_pair"])) {
            assert_eq!((output.name.as_str(), output.stream, output.buffer), (name, stream, stream));
            assert_eq!((u64::from(output.stride), output.offset, u64::from(output.size)), (PAIR_BYTES, 0, PAIR_BYTES));
        }
    }
}

/// Rust sources below a folder.
fn sources(folder: &Path, list: &mut Vec<PathBuf>) {
    for entry in folder.read_dir().expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, list);
        } else if path.extension().is_some_and(|e| e == "rs") {
            list.push(path);
        }
    }
}

/// Mentions in code, comments apart, of what a folder must not know.
fn forbidden<'a>(code: &'a str, names: &[&str]) -> Vec<&'a str> {
    code.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .filter(|line| {
            line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'))
                .any(|word| names.iter().any(|n| word == *n || word.starts_with(&format!("{n}::"))))
        })
        .collect()
}

#[test]
fn data_flows_downwards_only() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let above = [
        "ash",
        "gpu_allocator",
        "crate::gpu",
        "crate::passes",
        "crate::frames",
        "crate::cli",
        "crate::viewer",
        "super::super::gpu",
        "super::super::passes",
        "super::super::frames",
    ];
    // Scenes, files, preprocessing and the reference renderer know nothing of the device, so that they can be tested,
    // and trusted, without one. The device layer knows nothing of what it draws.
    let folders: [(&str, &[&str]); 9] = [
        ("scene", &above),
        ("formats", &above),
        ("preprocess", &above),
        ("reference", &above),
        ("probes", &above),
        (
            "gpu",
            &["crate::passes", "crate::frames", "crate::scene", "crate::preprocess", "crate::cli", "crate::viewer"],
        ),
        ("passes", &["crate::frames", "crate::cli", "crate::viewer"]),
        ("frames", &["crate::cli", "crate::viewer"]),
        ("viewer", &["crate::cli", "crate::passes"]),
    ];
    for (folder, names) in folders {
        let mut files = Vec::new();
        sources(&root.join(folder), &mut files);
        assert!(files.len() > 2, "{folder} has hardly any sources");
        for file in files {
            let code = std::fs::read_to_string(&file).expect("a source");
            assert_eq!(forbidden(&code, names), Vec::<&str>::new(), "{} looks upwards", file.display());
        }
    }
}

#[test]
fn looking_upwards_is_noticed() {
    let names = ["ash", "crate::passes"];
    assert_eq!(forbidden("use ash::vk;", &names).len(), 1);
    assert_eq!(forbidden("    let s = crate::passes::sin2_of_share(0.1);", &names).len(), 1);
    assert_eq!(forbidden("/// [`crate::passes::sin2_of_share`]\nlet hash = flash();", &names).len(), 0);
}
