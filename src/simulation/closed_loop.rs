//! The closed loop of a scenario by type: plant, controller, estimator, and the configurations of their models.

use fmu_export::Invalid;

use crate::control::controller::ControllerConfig;
use crate::fmu::{controller, plant};
use crate::machine::PLANAR;
use crate::plant::PlantConfig;
use crate::simulation::scenario::{Element, Scenario};

/// The initial configurations of the models in the loop.
#[derive(Clone, Debug)]
pub struct Loop {
    /// The plant.
    pub plant: PlantConfig,
    /// The controller.
    pub controller: ControllerConfig,
}

impl Scenario {
    /// The plant.
    pub fn plant(&self) -> &Element {
        &self.elements[0]
    }

    /// The controller.
    pub fn controller(&self) -> &Element {
        &self.elements[1]
    }

    /// The estimator in the loop.
    pub fn estimator(&self) -> &Element {
        &self.elements[2]
    }

    /// Plant, controller and estimator.
    pub fn in_loop(&self) -> &[Element] {
        &self.elements[..3]
    }

    /// Estimators that run beside the loop on the same data.
    pub fn observers(&self) -> &[Element] {
        self.elements.get(3..).unwrap_or_default()
    }

    /// Removes the estimators beside the loop.
    pub fn remove_observers(&mut self) {
        self.elements.truncate(3);
    }

    /// The path of a variable, such as `plant.lambda[1]`, from the indices of its element and its own.
    pub fn path(&self, (element, variable): (usize, usize)) -> String {
        let element = &self.elements[element];
        format!("{}.{}", element.name, element.model_type.variables()[variable].name)
    }

    /// The configurations of the models in the loop.
    ///
    /// # Errors
    /// Another machine than the planar one; every value that is not an item of its enumeration. A scenario of that machine that can be run has
    /// none. Ranges are not checked.
    pub fn closed_loop(&self) -> Result<Loop, Vec<Invalid>> {
        let (own, planar) = (self.machine.name, PLANAR.name);
        if own != planar {
            let wanted = format!("{planar}: this is for the planar bearing with three magnets alone");
            return Err(vec![Invalid { name: "machine".into(), value: own.into(), wanted: wanted.into() }]);
        }
        let (plant, _) = plant::configuration::<2, 3, 1>(&self.plant().values());
        Ok(Loop { plant, controller: controller::configuration(&self.controller().values()) })
    }
}
