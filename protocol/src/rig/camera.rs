//! The projector as a camera: world point to pixel, and back to a ray.

use super::Projector;
use glam::{DMat3, DVec2, DVec3};

/// A pinhole with two terms of radial distortion. Pixels: origin at the image's top left corner, centres at half-integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The nodal point P in world metres.
    pub position: DVec3,
    /// Homogeneous pixels from a world direction: (u w, v w, w), w the depth in any positive scale.
    pixel_from_world: DMat3,
    world_from_pixel: DMat3,
    principal_px: DVec2,
    focal_px: DVec2,
    radial: [f64; 2],
    /// The square of the ideal radius, in focal lengths, at which the distortion stops growing: beyond it the image folds back.
    fold_squared: f64,
}

/// The radial distortion by itself: an ideal pixel at `principal + focal · x` is seen at `principal + focal · x (1 + k1 x² + k2 x⁴)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// The centre of the distortion.
    pub principal_px: DVec2,
    /// Pixels across and down in a unit of the radius.
    pub focal_px: DVec2,
    /// k1, k2.
    pub radial: [f64; 2],
    /// The square of the radius beyond which a ray has no pixel, since the image would fold back there.
    pub fold_squared: f64,
}

/// Why a projector is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CameraError {
    Incomplete,
    Overdetermined,
    LooksNowhere,
    Affine,
    Behind,
    Mirrored,
    Folded,
}

impl Camera {
    pub(super) fn new(projector: &Projector) -> Result<Self, CameraError> {
        let (pixel_from_world, position) = match projector {
            Projector { matrix: Some(rows), position_m: None, look_at_m: None, image_down: None, .. }
                if projector.focal_px.is_none() && projector.principal_px.is_none() =>
            {
                from_matrix(rows)?
            }
            Projector { matrix: Some(_), .. } => return Err(CameraError::Overdetermined),
            Projector {
                position_m: Some(position),
                look_at_m: Some(look_at),
                image_down: Some(down),
                focal_px: Some(focal),
                principal_px: Some(principal),
                ..
            } => from_pose((*position).into(), (*look_at).into(), (*down).into(), *focal, (*principal).into())?,
            _ => return Err(CameraError::Incomplete),
        };
        let row = |index: usize| pixel_from_world.row(index);
        let depth = row(2).length_squared();
        let camera = Self {
            position,
            pixel_from_world,
            world_from_pixel: pixel_from_world.inverse(),
            principal_px: DVec2::new(row(0).dot(row(2)), row(1).dot(row(2))) / depth,
            focal_px: DVec2::new(row(0).cross(row(2)).length(), row(1).cross(row(2)).length()) / depth,
            radial: projector.radial,
            fold_squared: fold_squared(projector.radial),
        };
        let size = DVec2::new(projector.width_px.into(), projector.height_px.into());
        if camera.folds(size) { Err(CameraError::Folded) } else { Ok(camera) }
    }

    /// Homogeneous pixels, before distortion, from world directions: (u w, v w, w) of X is this times X − [`Camera::position`].
    pub fn pixel_from_world(&self) -> DMat3 {
        self.pixel_from_world
    }

    /// The distortion; `None` where lines stay straight: projection is a matrix.
    pub fn lens(&self) -> Option<Lens> {
        let Self { principal_px, focal_px, radial, fold_squared, .. } = *self;
        (!self.is_rectilinear()).then_some(Lens { principal_px, focal_px, radial, fold_squared })
    }

    /// The pixel at which world point `point` appears; `None` where it is not in front, or so far aside that the lens's polynomial
    /// folds back or numbers end.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let homogeneous = self.pixel_from_world * (point - self.position);
        if homogeneous.z.is_nan() || homogeneous.z <= 0.0 {
            return None;
        }
        self.distort(homogeneous.truncate() / homogeneous.z).filter(|pixel| pixel.is_finite())
    }

    /// The unit direction, from [`Camera::position`], of the ray through `pixel`.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        (self.world_from_pixel * self.undistort(pixel).extend(1.0)).normalize()
    }

    /// Whether lines stay straight: projection is a matrix.
    pub fn is_rectilinear(&self) -> bool {
        self.radial == [0.0; 2]
    }

    fn gain(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.radial[0] + r2 * self.radial[1])
    }

    fn distort(&self, pixel: DVec2) -> Option<DVec2> {
        if self.is_rectilinear() {
            return Some(pixel);
        }
        let ideal = (pixel - self.principal_px) / self.focal_px;
        let r2 = ideal.length_squared();
        (r2 < self.fold_squared).then(|| self.principal_px + self.focal_px * ideal * self.gain(r2))
    }

    /// The ideal pixel, as a pinhole would have it, of what is seen at `pixel`.
    ///
    /// Newton on the radius: the polynomial rises over the image, which [`Camera::new`] has checked.
    pub fn undistort(&self, pixel: DVec2) -> DVec2 {
        let seen = (pixel - self.principal_px) / self.focal_px;
        let goal = seen.length();
        if self.is_rectilinear() || goal == 0.0 {
            return pixel;
        }
        let mut radius = goal;
        for _ in 0..30 {
            let step = (radius * self.gain(radius * radius) - goal) / self.slope(radius);
            radius = (radius - step).clamp(0.0, 4.0 * goal);
            if step.abs() < 1e-15 {
                break;
            }
        }
        self.principal_px + self.focal_px * seen * (radius / goal)
    }

    /// d(distorted radius) / d(radius).
    fn slope(&self, radius: f64) -> f64 {
        let r2 = radius * radius;
        1.0 + r2 * (3.0 * self.radial[0] + r2 * 5.0 * self.radial[1])
    }

    /// Whether two rays share a pixel of the image: the radius stops growing before it has reached the farthest corner.
    fn folds(&self, size: DVec2) -> bool {
        if self.is_rectilinear() {
            return false;
        }
        let corner = [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size]
            .into_iter()
            .map(|corner| ((corner - self.principal_px) / self.focal_px).length())
            .fold(0.0, f64::max);
        let mut radius: f64 = 0.0;
        while radius * self.gain(radius * radius) < corner {
            if self.slope(radius) <= 0.05 || radius > 4.0 * corner {
                return true;
            }
            radius += corner / 256.0;
        }
        self.slope(radius) <= 0.05
    }
}

/// The first r² at which 1 + 3 k1 r² + 5 k2 r⁴, the radius's growth, is 0; infinity where it never is.
fn fold_squared([k1, k2]: [f64; 2]) -> f64 {
    let discriminant = 9.0 * k1 * k1 - 20.0 * k2;
    // The smaller positive root of the quadratic, in the form that loses no digits and holds for k2 = 0.
    let denominator = discriminant.sqrt() - 3.0 * k1;
    if discriminant >= 0.0 && denominator > 0.0 { 2.0 / denominator } else { f64::INFINITY }
}

fn from_pose(
    position: DVec3,
    look_at: DVec3,
    image_down: DVec3,
    focal: f64,
    principal: DVec2,
) -> Result<(DMat3, DVec3), CameraError> {
    let forward = (look_at - position).try_normalize().ok_or(CameraError::LooksNowhere)?;
    let down = image_down.reject_from_normalized(forward);
    if down.length() <= 1e-6 * image_down.length() {
        return Err(CameraError::LooksNowhere);
    }
    let down = down.normalize();
    let right = down.cross(forward);
    let rows = [focal * right + principal.x * forward, focal * down + principal.y * forward, forward];
    Ok((DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(), position))
}

fn from_matrix(rows: &[[f64; 4]; 3]) -> Result<(DMat3, DVec3), CameraError> {
    let row = |index: usize| DVec3::new(rows[index][0], rows[index][1], rows[index][2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let scale = row(0).length() * row(1).length() * row(2).length();
    let determinant = matrix.determinant();
    if determinant.is_nan() || determinant.abs() <= 1e-12 * scale {
        return Err(CameraError::Affine);
    }
    if rows[2][3] <= 0.0 {
        return Err(CameraError::Behind);
    }
    if determinant < 0.0 {
        return Err(CameraError::Mirrored);
    }
    let position = -(matrix.inverse() * DVec3::new(rows[0][3], rows[1][3], rows[2][3]));
    Ok((matrix, position))
}
