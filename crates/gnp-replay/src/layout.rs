//! How the viewer lays a file out: the road, with a text behind it, and scalars of the picked
//! vehicle beside it. Rerun calls it a blueprint, a second store in the file.

use gnp_force::{Arity, TermDescriptor};
use gnp_plot::{Clip, ClipVehicle};
use re_chunk::TimePoint;
use re_log_types::TimeCell;
use re_sdk_types::AsComponents;
use re_sdk_types::blueprint::archetypes::{
    Background, ContainerBlueprint, EyeControls3D, LineGrid3D, PanelBlueprint, TimePanelBlueprint, ViewBlueprint,
    ViewContents, ViewportBlueprint,
};
use re_sdk_types::blueprint::components::{
    BackgroundKind, ColumnShare, ContainerKind, IncludedContent, LoopMode, PanelState, QueryExpression, RootContainer,
    TimelineName, ViewClass,
};
use re_sdk_types::components::Name;
use re_sdk_types::datatypes::{AbsoluteTimeRange, TimeInt};
use re_sdk_types::external::uuid::Uuid;

use crate::colour::Colour;
use crate::error::ReplayError;
use crate::records::scalar;
use crate::rrd::{Chunks, color, nanoseconds};

/// Where the eye is from the picked vehicle, m: above the right-hand side of the road, so that forward is to the right
/// and left is up. How far, follows from the size of the ring.
const EYE_M: [f32; 3] = [0., -35., 80.];

/// Something that stands in a container.
struct Part {
    path: String,
    /// Of the width, where the container is horizontal.
    share: f32,
}

fn part(container: Uuid, share: f32) -> Part {
    Part { path: format!("container/{container}"), share }
}

/// The blueprint as chunks.
pub(crate) fn chunks(clip: &Clip, picked: Option<u32>) -> Result<Chunks, ReplayError> {
    let mut blueprint = Blueprint::default();
    let road = blueprint.road(clip, picked)?;
    let about = blueprint.view("TextDocument", "About", "/about", &["$origin"])?;
    let left = blueprint.container(ContainerKind::Tabs, &[road, about])?;
    let mut parts = vec![part(left, 2.)];
    if let Some(id) = picked {
        let right = blueprint.scalars(id, &clip.terms())?;
        parts.push(part(right, 1.));
    }
    let root = blueprint.container(ContainerKind::Horizontal, &parts)?;
    blueprint.add("viewport", &ViewportBlueprint::new().with_root_container(RootContainer(root.into())))?;
    blueprint.add("time_panel", &times(clip, picked))?;
    blueprint.add("selection_panel", &PanelBlueprint::new().with_state(PanelState::Collapsed))?;
    Ok(blueprint.chunks)
}

/// The stretches of the picked vehicle.
fn stretches(clip: &Clip, picked: Option<u32>) -> impl Iterator<Item = &ClipVehicle> {
    clip.vehicles.iter().filter(move |vehicle| picked == Some(vehicle.id))
}

/// Plays in a loop what there is of the picked vehicle from its first forecast on.
fn times(clip: &Clip, picked: Option<u32>) -> TimePanelBlueprint {
    let panel = TimePanelBlueprint::new().with_timeline(TimelineName::from("time"));
    let first = stretches(clip, picked).filter_map(|vehicle| vehicle.forecasts.first()).map(|forecast| forecast.frame);
    let last = stretches(clip, picked).filter_map(|vehicle| vehicle.states.last()).map(|state| state.frame);
    let (Some(first), Some(last)) = (first.min(), last.max()) else { return panel };
    let at = |frame| TimeInt(nanoseconds(frame, clip.rate_hz));
    panel.with_loop_mode(LoopMode::Selection).with_time_selection(AbsoluteTimeRange { min: at(first), max: at(last) })
}

#[derive(Default)]
struct Blueprint {
    chunks: Chunks,
    /// Views and containers so far.
    named: u128,
}

impl Blueprint {
    fn add(&mut self, path: &str, part: &(impl AsComponents + Clone + 'static)) -> Result<(), ReplayError> {
        let time = TimePoint::default().with_index("blueprint", TimeCell::from_sequence(0));
        self.chunks.add(path, [(time, Box::new(part.clone()) as Box<dyn AsComponents>)])
    }

    fn name(&mut self) -> Uuid {
        self.named += 1;
        Uuid::from_u128(self.named)
    }

    fn view(&mut self, class: &str, name: &str, origin: &str, contents: &[&str]) -> Result<Part, ReplayError> {
        let path = format!("view/{}", self.name());
        let queries = contents.iter().map(|query| QueryExpression::from(*query));
        self.add(&format!("{path}/ViewContents"), &ViewContents::new(queries))?;
        let view =
            ViewBlueprint::new(ViewClass::from(class)).with_display_name(Name::from(name)).with_space_origin(origin);
        self.add(&path, &view)?;
        Ok(Part { path, share: 1. })
    }

    fn container(&mut self, kind: ContainerKind, parts: &[Part]) -> Result<Uuid, ReplayError> {
        let name = self.name();
        let container = ContainerBlueprint::new(kind)
            .with_contents(parts.iter().map(|part| IncludedContent::from(part.path.as_str())));
        let shares = parts.iter().map(|part| ColumnShare::from(part.share));
        let container = if kind == ContainerKind::Horizontal { container.with_col_shares(shares) } else { container };
        self.add(&format!("container/{name}"), &container)?;
        Ok(name)
    }

    fn road(&mut self, clip: &Clip, picked: Option<u32>) -> Result<Part, ReplayError> {
        let forecasts = picked.map(|id| format!("+ /forecasts/{id}/**"));
        let mut contents = vec!["+ /road/**", "+ /vehicles/**", "+ /picked"];
        contents.extend(forecasts.as_deref());
        let road = self.view("3D", &clip.heading(), "/", &contents)?;
        let background = Background::new(BackgroundKind::SolidColor).with_color(color(Colour::ROAD));
        self.add(&format!("{}/Background", road.path), &background)?;
        self.add(&format!("{}/LineGrid3D", road.path), &LineGrid3D::new().with_visible(false))?;
        let first = stretches(clip, picked).next().and_then(|vehicle| vehicle.states.first());
        if let Some([x, y]) = first.map(|state| state.centre) {
            let [dx, dy, z] = EYE_M;
            let eye = EyeControls3D::new()
                .with_position([x + dx, y + dy, z])
                .with_look_target([x, y, 0.])
                .with_tracking_entity("/picked");
            self.add(&format!("{}/EyeControls3D", road.path), &eye)?;
        }
        Ok(road)
    }

    fn scalars(&mut self, id: u32, terms: &[&TermDescriptor]) -> Result<Uuid, ReplayError> {
        let mut shown = vec![("Speed, m/s".to_owned(), "speed".to_owned())];
        for term in terms {
            for parameter in term.varying() {
                let (name, unit) = (capitalised(&parameter.meaning), &parameter.unit);
                let name = if term.arity == Arity::One {
                    format!("{name}, {unit}")
                } else {
                    format!("{name} of {}, {unit}", term.label)
                };
                shown.push((name, scalar(&term.name, &parameter.name)));
            }
        }
        shown.push(("Probability of paths".to_owned(), "probability".to_owned()));
        let mut parts = Vec::new();
        for (name, entity) in shown {
            let origin = format!("/scalars/{id}/{entity}");
            parts.push(self.view("TimeSeries", &format!("{name}: vehicle {id}"), &origin, &["$origin/**"])?);
        }
        self.container(ContainerKind::Vertical, &parts)
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
