//! The panel's section on lamps.

use egui::{DragValue, Slider, SliderClamping, Ui};
use glam::DVec3;

use super::controller::Controller;
use super::lamp_control::NewLamp;
use super::panel::choice;
use crate::frames::lamps::LampSettings;
use crate::scene::{Lamp, LampKind};

/// Shows them, and does what is asked for.
pub(super) fn show(ui: &mut Ui, controller: &mut Controller) {
    ui.separator();
    ui.horizontal(|ui| {
        ui.strong("Lamps");
        for (kind, name) in [(NewLamp::Spot, "+ spot"), (NewLamp::Point, "+ point"), (NewLamp::Sun, "+ sun")] {
            if ui.small_button(name).clicked() {
                controller.add_new_lamp(kind);
            }
        }
    });
    let count = controller.state.lamps.lamps.len();
    if count == 0 {
        return;
    }
    let mut removed = None;
    for (number, lamp) in controller.state.lamps.lamps.iter().enumerate() {
        ui.horizontal(|ui| {
            let text = format!("{} {}, {} W", number + 1, name(lamp), lamp.power);
            if ui.selectable_label(number == controller.lamp, text).clicked() {
                controller.lamp = number;
            }
            if ui.small_button("remove").clicked() {
                removed = Some(number);
            }
        });
    }
    if let Some(lamp) = controller.chosen_lamp() {
        let changed = edited(ui, *lamp);
        controller.change_lamp(controller.lamp, changed);
    }
    settings(ui, controller);
    if let Some(number) = removed {
        controller.remove_lamp(number);
    }
}

fn name(lamp: &Lamp) -> &'static str {
    match lamp.kind {
        LampKind::Spot { .. } => "spot",
        LampKind::Point { .. } => "point",
        LampKind::Sun { .. } => "sun",
    }
}

/// The lamp as it is after a frame of its widgets.
fn edited(ui: &mut Ui, mut lamp: Lamp) -> Lamp {
    match &mut lamp.kind {
        LampKind::Spot { at, to, degrees } => {
            vector(ui, "at", at);
            vector(ui, "to", to);
            ui.add(Slider::new(degrees, Lamp::DEGREES).fixed_decimals(0).suffix("°").text("angle"));
        }
        LampKind::Point { at } => vector(ui, "at", at),
        LampKind::Sun { direction } => vector(ui, "direction", direction),
    }
    ui.horizontal(|ui| {
        let speed = 0.01 * lamp.power;
        ui.add(DragValue::new(&mut lamp.power).speed(speed).range(1e-6..=1e9).max_decimals(3).suffix(" W"));
        let mut color = lamp.color.to_array();
        if ui.color_edit_button_rgb(&mut color).changed() {
            lamp.color = color.into();
        }
        ui.label("power, colour");
    });
    lamp
}

fn vector(ui: &mut Ui, label: &str, value: &mut DVec3) {
    ui.horizontal(|ui| {
        for axis in [&mut value.x, &mut value.y, &mut value.z] {
            ui.add(DragValue::new(axis).speed(0.01).fixed_decimals(2));
        }
        ui.label(label);
    });
}

/// How the light of all of them is found.
fn settings(ui: &mut Ui, controller: &mut Controller) {
    let method = controller.state.method(true, true);
    let lamps = &mut controller.state.lamps;
    let before = lamps.clone();
    // What a file says beyond these is kept.
    let slider = |value, range| Slider::new(value, range).clamping(SliderClamping::Edits);
    ui.add(slider(&mut lamps.bounces, 0..=4).text("bounces"));
    let range = *LampSettings::VPLS.start()..=1024;
    if ui.add(slider(&mut lamps.vpls, range).step_by(16.0).logarithmic(true).text("lights")).changed() {
        lamps.vpls = lamps.vpls.next_multiple_of(16);
    }
    choice(ui, "interleaving", &mut lamps.interleave, &[(1, "1 x 1"), (2, "2 x 2"), (4, "4 x 4")]);
    let mut share = f64::from(lamps.share(method));
    if ui.add(Slider::new(&mut share, 0.0..=1.0).clamping(SliderClamping::Edits).text("scan light")).changed() {
        lamps.scan_light = Some(share);
    }
    if *lamps != before {
        controller.touch();
    }
}
