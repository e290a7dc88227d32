//! Numbers out of glTF buffers, of any component type, also sparse, with every bound checked. The readers of the `gltf`
//! crate trust strides, counts and types that its validation does not check, and panic on wrong ones.

use gltf::accessor::{DataType, sparse::IndexType};
use gltf::{Accessor, buffer::View};

use super::Fault;

/// Accessors without any bytes behind them are zeros for free; more of them are refused.
const UNBACKED_MAX: usize = 1 << 20;

/// The buffers of a document, as many as it has.
pub(super) struct Buffers(pub Vec<Vec<u8>>);

impl Buffers {
    /// Elements of `N` components. Integers are scaled to -1 to 1 or 0 to 1 where the accessor is normalised.
    pub fn floats<const N: usize>(&self, place: &str, accessor: &Accessor<'_>) -> Result<Vec<[f32; N]>, Fault> {
        let scale = if accessor.normalized() { full_range(accessor.data_type()) } else { 1.0 };
        let elements = self.elements::<N>(place, accessor)?;
        // The format lets the lowest signed integer, too, mean -1.
        let component = |value: f64| if scale == 1.0 { value as f32 } else { (value / scale).max(-1.0) as f32 };
        Ok(elements.into_iter().map(|element| element.map(component)).collect())
    }

    /// Elements of `N` whole numbers.
    pub fn integers<const N: usize>(&self, place: &str, accessor: &Accessor<'_>) -> Result<Vec<[u32; N]>, Fault> {
        if !matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::U32) {
            let problem = format!("component type {:?}, allowed are U8, U16 and U32", accessor.data_type());
            return Err(Fault::malformed(format!("{place} accessor {}", accessor.index()), problem));
        }
        Ok(self.elements::<N>(place, accessor)?.into_iter().map(|element| element.map(|v| v as u32)).collect())
    }

    fn elements<const N: usize>(&self, place: &str, accessor: &Accessor<'_>) -> Result<Vec<[f64; N]>, Fault> {
        let place = format!("{place} accessor {}", accessor.index());
        let components = accessor.dimensions().multiplicity();
        if components != N {
            return Err(Fault::malformed(place, format!("{components} components, allowed are {N}")));
        }
        let (kind, count) = (accessor.data_type(), accessor.count());
        let mut elements = match accessor.view() {
            Some(view) => {
                let bytes = self.view(&place, &view)?;
                let rows = rows(&place, bytes, accessor.offset(), view.stride(), N * size(kind), count)?;
                rows.map(|row| element(row, kind)).collect()
            }
            None if count <= UNBACKED_MAX => vec![[0.0; N]; count],
            None => {
                let (what, limit) = ("elements without a buffer view", UNBACKED_MAX as u64);
                return Err(Fault::TooLarge { place, count: count as u64, what, limit });
            }
        };
        if let Some(sparse) = accessor.sparse() {
            self.substitute(&place, &sparse, kind, &mut elements)?;
        }
        Ok(elements)
    }

    fn substitute<const N: usize>(
        &self,
        place: &str,
        sparse: &gltf::accessor::sparse::Sparse<'_>,
        kind: DataType,
        elements: &mut [[f64; N]],
    ) -> Result<(), Fault> {
        let (indices, values) = (sparse.indices(), sparse.values());
        let index_kind = match indices.index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let count = sparse.count();
        let (index_view, value_view) = (indices.view(), values.view());
        let index_bytes = self.view(place, &index_view)?;
        let value_bytes = self.view(place, &value_view)?;
        let at = rows(place, index_bytes, indices.offset(), index_view.stride(), size(index_kind), count)?;
        let new = rows(place, value_bytes, values.offset(), value_view.stride(), N * size(kind), count)?;
        for (at, new) in at.zip(new) {
            let index = scalar(at, index_kind) as usize;
            let limit = elements.len();
            let Some(old) = elements.get_mut(index) else {
                let allowed = format!("sparse indices below {limit}");
                return Err(Fault::IndexOutOfRange { place: place.into(), index: index as i64, allowed });
            };
            *old = element(new, kind);
        }
        Ok(())
    }

    /// The bytes of a buffer view.
    pub fn view(&self, place: &str, view: &View<'_>) -> Result<&[u8], Fault> {
        let buffer = &self.0[view.buffer().index()];
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| buffer.get(view.offset()..end)).ok_or_else(|| {
            let place = format!("{place} buffer view {}", view.index());
            let problem = format!(
                "{} bytes at {}, but buffer {} holds {} (truncated?)",
                view.length(),
                view.offset(),
                view.buffer().index(),
                buffer.len()
            );
            Fault::malformed(place, problem)
        })
    }
}

/// Rows of `size` bytes, `stride` apart.
fn rows<'b>(
    place: &str,
    bytes: &'b [u8],
    offset: usize,
    stride: Option<usize>,
    size: usize,
    count: usize,
) -> Result<impl Iterator<Item = &'b [u8]> + use<'b>, Fault> {
    let stride = stride.unwrap_or(size);
    if stride < size {
        return Err(Fault::malformed(place, format!("stride {stride} bytes, allowed are at least {size}")));
    }
    let needed = match count {
        0 => Some(offset),
        n => (n - 1).checked_mul(stride).and_then(|n| n.checked_add(size)).and_then(|n| n.checked_add(offset)),
    };
    if needed.is_none_or(|needed| needed > bytes.len()) {
        let problem = format!(
            "{count} elements of {size} bytes, {stride} apart, from byte {offset}, but its buffer view holds {} (truncated?)",
            bytes.len()
        );
        return Err(Fault::malformed(place, problem));
    }
    Ok((0..count).map(move |i| &bytes[offset + i * stride..][..size]))
}

fn element<const N: usize>(row: &[u8], kind: DataType) -> [f64; N] {
    std::array::from_fn(|i| scalar(&row[i * size(kind)..], kind))
}

fn scalar(bytes: &[u8], kind: DataType) -> f64 {
    match kind {
        DataType::I8 => f64::from(bytes[0] as i8),
        DataType::U8 => f64::from(bytes[0]),
        DataType::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}

fn size(kind: DataType) -> usize {
    match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

fn full_range(kind: DataType) -> f64 {
    match kind {
        DataType::I8 => f64::from(i8::MAX),
        DataType::U8 => f64::from(u8::MAX),
        DataType::I16 => f64::from(i16::MAX),
        DataType::U16 => f64::from(u16::MAX),
        DataType::U32 => f64::from(u32::MAX),
        DataType::F32 => 1.0,
    }
}
