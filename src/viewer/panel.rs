//! The side panel, and what is written over the picture.

use std::path::Path;

use egui::{Align2, Color32, FontId, RichText, Sense, Ui, Vec2};

use super::controller::{Controller, Input};
use super::lamp_panel as lamps;
use super::messages::Stage;
use super::state::{Named, ViewState};
use crate::frames::{FrameStats, MaterialChoice, Method, Quality, Settings};

/// Width of the panel, points.
const WIDTH: f32 = 250.0;
/// Passes that get a bar, the slowest.
const BARS: usize = 10;

/// Shows the panel along the right side.
pub(super) fn show(ui: &mut Ui, controller: &mut Controller) {
    egui::Panel::right("panel").exact_size(WIDTH).show(ui, |ui| {
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            ui.spacing_mut().slider_width = 100.0;
            rendering(ui, controller);
            object(ui, controller);
            lamps::show(ui, controller);
            display(ui, controller);
            probes(ui, controller);
            files(ui, controller);
            if let Some(picture) = &controller.picture {
                timings(ui, &picture.stats, picture.ms);
                pairs(ui, &picture.stats);
            }
            if let Some(error) = &controller.shader_error {
                ui.separator();
                ui.label(RichText::new(error).color(Color32::LIGHT_RED).monospace());
            }
        });
    });
}

/// A menu of named values.
pub(super) fn choice<T: PartialEq + Copy>(ui: &mut Ui, label: &str, value: &mut T, options: &[(T, &str)]) {
    let name = options.iter().find(|(option, _)| option == value).map_or("", |(_, name)| name);
    ui.horizontal(|ui| {
        egui::ComboBox::from_id_salt(label).selected_text(name).width(110.0).show_ui(ui, |ui| {
            for (option, name) in options {
                ui.selectable_value(value, *option, *name);
            }
        });
        ui.label(label);
    });
}

fn rendering(ui: &mut Ui, controller: &mut Controller) {
    ui.strong("Light");
    let state = &mut controller.state;
    choice(ui, "quality", &mut state.quality, &Quality::ALL.map(|q| (q, q.name())));
    let mut techniques = vec![(None, "by quality")];
    techniques.extend(Method::ALL.map(|method| (Some(method), method.name())));
    choice(ui, "technique", &mut state.technique, &techniques);
    let default = state.quality.settings().microbuffer;
    let mut size = state.microbuffer.unwrap_or(default);
    let slider = egui::Slider::new(&mut size, Settings::MICROBUFFER).step_by(2.0).text("micro-buffer");
    if ui.add(slider).changed() {
        // Sizes are even.
        let size = size / 2 * 2;
        state.microbuffer = (size != default).then_some(size);
    }
}

fn object(ui: &mut Ui, controller: &mut Controller) {
    ui.separator();
    ui.strong("Object");
    let before = (controller.state.material, controller.state.placement);
    let state = &mut controller.state;
    let kinds = [
        (MaterialChoice::File, "file"),
        (MaterialChoice::Diffuse(0.7), "diffuse"),
        (MaterialChoice::Metal(0.25), "metal"),
    ];
    let mut kind = match state.material {
        MaterialChoice::File => 0,
        MaterialChoice::Diffuse(_) => 1,
        MaterialChoice::Metal(_) => 2,
    };
    let was = kind;
    choice(ui, "material", &mut kind, &[(0, kinds[0].1), (1, kinds[1].1), (2, kinds[2].1)]);
    if kind != was {
        state.material = kinds[kind].0;
    }
    match &mut state.material {
        MaterialChoice::File => {}
        MaterialChoice::Diffuse(albedo) => {
            ui.add(egui::Slider::new(albedo, 0.0..=1.0).text("albedo"));
        }
        MaterialChoice::Metal(alpha) => {
            ui.add(egui::Slider::new(alpha, 0.02..=1.0).logarithmic(true).text("GGX alpha"));
        }
    }
    let placement = &mut state.placement;
    ui.add(egui::Slider::new(&mut placement.turn, -360.0..=360.0).suffix("°").text("turn"));
    ui.add(egui::Slider::new(&mut placement.scale, 0.01..=100.0).logarithmic(true).text("scale"));
    if let Some(at) = &mut placement.at {
        ui.horizontal(|ui| {
            for axis in [&mut at.x, &mut at.y, &mut at.z] {
                ui.add(egui::DragValue::new(axis).speed(0.01).fixed_decimals(2));
            }
            ui.label("at");
        });
    }
    if before != (state.material, state.placement) {
        controller.touch();
    }
}

fn display(ui: &mut Ui, controller: &mut Controller) {
    ui.separator();
    ui.strong("Display");
    let state = &mut controller.state;
    ui.add(egui::Slider::new(&mut state.exposure, -8.0..=8.0).fixed_decimals(1).suffix(" EV").text("exposure"));
    choice(ui, "tone curve", &mut state.tone, Named::NAMES);
    choice(ui, "points", &mut state.points, Named::NAMES);
}

fn probes(ui: &mut Ui, controller: &mut Controller) {
    let Some(probes) = &controller.state.probes else { return };
    ui.separator();
    ui.strong("Probes");
    let text = name(Some(&probes.path));
    let removed = ui
        .horizontal(|ui| {
            ui.label(text);
            ui.small_button("remove").clicked()
        })
        .inner;
    // Probes that do not change have no frames.
    if let Some(frame) = controller.picture.as_ref().and_then(|picture| picture.frame) {
        let playing = controller.state.playing;
        ui.horizontal(|ui| {
            if ui.button(if playing { "Pause" } else { "Play" }).clicked() {
                controller.input(Input::Play(!playing));
            }
            ui.label(format!("frame {frame}"));
        });
    }
    if removed {
        controller.state.probes = None;
    }
}

fn name(path: Option<&Path>) -> String {
    let name = path.and_then(|path| path.file_name());
    name.map_or("none".to_owned(), |name| name.to_string_lossy().into_owned())
}

fn files(ui: &mut Ui, controller: &mut Controller) {
    ui.separator();
    ui.strong("Scene");
    let state = &mut controller.state;
    ui.label(format!("cloud: {}", name(state.cloud.as_deref())));
    ui.label(format!("object: {}", name(state.object.as_deref())));
    ui.horizontal(|ui| {
        ui.label(format!("far field: {}", name(state.environment.as_deref())));
        if state.environment.is_some() && ui.small_button("remove").clicked() {
            state.environment = None;
        }
    });
    ui.weak("Drop files on the window to open them.");
    let mut path = controller.scene_path.display().to_string();
    if ui.add(egui::TextEdit::singleline(&mut path).desired_width(f32::INFINITY)).changed() {
        controller.scene_path = path.into();
    }
    ui.horizontal(|ui| {
        if ui.button("Save").clicked() {
            controller.input(Input::Save);
        }
        if ui.button("Open").clicked() {
            controller.input(Input::Reopen);
        }
        if ui.button("Screenshot").clicked() {
            controller.input(Input::Screenshot);
        }
    });
}

fn timings(ui: &mut Ui, stats: &FrameStats, ms: f64) {
    ui.separator();
    ui.strong(format!("Passes: {:.1} of {ms:.1} ms", stats.profile.total_ms()));
    let mut passes: Vec<(&str, f64)> = stats.profile.passes.iter().map(|(name, pass)| (*name, pass.gpu_ms)).collect();
    passes.sort_by(|a, b| b.1.total_cmp(&a.1));
    passes.truncate(BARS);
    let longest = passes.first().map_or(1.0, |(_, ms)| ms.max(1e-6));
    for (name, ms) in passes {
        let height = 15.0;
        let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), height), Sense::hover());
        let mut bar = rect;
        bar.set_width((rect.width() * (ms / longest) as f32).max(1.0));
        let painter = ui.painter();
        painter.rect_filled(bar.shrink2(Vec2::new(0.0, 1.0)), 2.0, Color32::from_rgb(38, 82, 120));
        let color = ui.visuals().strong_text_color();
        let font = FontId::proportional(11.0);
        painter.text(rect.left_center() + Vec2::new(4.0, 0.0), Align2::LEFT_CENTER, name, font.clone(), color);
        let right = rect.right_center() - Vec2::new(4.0, 0.0);
        painter.text(right, Align2::RIGHT_CENTER, format!("{ms:.2} ms"), font, color);
    }
}

/// Pairs that went round in each iteration of the traversal, on a logarithmic scale.
fn pairs(ui: &mut Ui, stats: &FrameStats) {
    if stats.pairs_by_iteration.is_empty() {
        return;
    }
    ui.separator();
    ui.strong(format!("Pairs by iteration: {} in all", stats.pairs_by_iteration.iter().sum::<u64>()));
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 56.0), Sense::hover());
    let count = stats.pairs_by_iteration.len() as f32;
    let height = |pairs: u64| ((pairs + 1) as f32).log2();
    let most = stats.pairs_by_iteration.iter().map(|pairs| height(*pairs)).fold(1.0, f32::max);
    for (i, pairs) in stats.pairs_by_iteration.iter().enumerate() {
        let left = rect.left() + rect.width() * i as f32 / count;
        let right = rect.left() + rect.width() * (i + 1) as f32 / count - 1.0;
        let top = rect.bottom() - rect.height() * height(*pairs) / most;
        let column = egui::Rect::from_min_max(egui::pos2(left, top), egui::pos2(right.max(left + 0.5), rect.bottom()));
        ui.painter().rect_filled(column, 0.0, Color32::from_rgb(120, 92, 38));
    }
}

/// What is written over the picture: the status, and how far loading is.
pub(super) fn overlay(ui: &Ui, area: egui::Rect, controller: &Controller) {
    let painter = ui.painter();
    let font = FontId::proportional(13.0);
    let color = Color32::from_gray(225);
    let write = |at, align, text: String| {
        let shadow = at + Vec2::splat(1.0);
        painter.text(shadow, align, &text, font.clone(), Color32::from_black_alpha(200));
        painter.text(at, align, text, font.clone(), color);
    };
    write(area.left_bottom() + Vec2::new(8.0, -6.0), Align2::LEFT_BOTTOM, controller.status.clone());
    if let Some(picture) = &controller.picture {
        let rate = match picture.stage {
            Stage::Moving => format!(", {:.0} a second", controller.rate()),
            Stage::Draft => ", draft".to_owned(),
            Stage::Finished => String::new(),
        };
        let frame = match picture.frame {
            Some(frame) if controller.state.playing => format!("frame {frame}, "),
            _ => String::new(),
        };
        let text = format!("{frame}{}x{} in {:.0} ms{rate}", picture.width, picture.height, picture.ms);
        write(area.right_top() + Vec2::new(-8.0, 6.0), Align2::RIGHT_TOP, text);
    } else if controller.loading.is_none() {
        let ViewState { cloud, object, environment, probes, .. } = &controller.state;
        let lit = cloud.is_some() || environment.is_some() || probes.is_some();
        let text = match (lit, object.is_some()) {
            (false, false) => "Drop a point cloud and an object on the window.",
            (false, true) => "Drop a point cloud or a panorama on the window.",
            (true, false) => "Drop an object on the window.",
            (true, true) => "",
        };
        write(area.center(), Align2::CENTER_CENTER, text.to_owned());
    }
    if let Some((what, share)) = &controller.loading {
        let bar = egui::Rect::from_center_size(area.center(), Vec2::new((0.6 * area.width()).min(320.0), 8.0));
        painter.rect_filled(bar, 4.0, Color32::from_black_alpha(160));
        let mut done = bar;
        done.set_width(bar.width() * share.clamp(0.02, 1.0));
        painter.rect_filled(done, 4.0, Color32::from_rgb(90, 150, 210));
        write(bar.center_top() - Vec2::new(0.0, 6.0), Align2::CENTER_BOTTOM, what.clone());
    }
}
