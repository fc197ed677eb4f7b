package develop

import "metrofarm/services/internal/film"

// Half sizes, in pixels, of the boxes that are averaged over.
const (
	varianceRadius  = 2 // the variance image: 5 x 5
	neighbourRadius = 4 // NeighbourMean: 9 x 9
)

// RGB returns the mean image.
func (m *Images) RGB() []float32 {
	out := make([]float32, len(m.Halves[0]))
	for i := range out {
		out[i] = float32(m.Mean(i))
	}
	return out
}

// VarianceImage returns the variance of each pixel's mean, averaged over 5 x 5 pixels (fewer at the
// edges): the half difference alone has one degree of freedom per value, the box brings it to about
// 25 at the price of its resolution.
func (m *Images) VarianceImage() []float32 {
	raw := make([]float64, len(m.Halves[0]))
	for i := range raw {
		raw[i] = m.Variance(i)
	}
	out := make([]float32, len(raw))
	for i, v := range m.smooth(raw, varianceRadius) {
		out[i] = float32(v)
	}
	return out
}

// NeighbourMean returns, for each value, the mean of the 9 x 9 pixels around it without its own: a
// stand-in for the unknown truth that does not share the value's own error.
func (m *Images) NeighbourMean() []float64 {
	width, height := m.Shape.Width, m.Shape.Height
	mean := make([]float64, len(m.Halves[0]))
	for i := range mean {
		mean[i] = m.Mean(i)
	}
	out := m.smooth(mean, neighbourRadius)
	for i := range out {
		pixel := i / film.Channels
		if n := reach(pixel%width, width) * reach(pixel/width, height); n > 1 {
			out[i] = max(0, (out[i]*float64(n)-mean[i])/float64(n-1))
		}
	}
	return out
}

// reach counts the positions that a box around i covers on an axis of the given length.
func reach(i, length int) int {
	return min(length-1, i+neighbourRadius) - max(0, i-neighbourRadius) + 1
}

func (m *Images) smooth(values []float64, radius int) []float64 {
	width, height := m.Shape.Width, m.Shape.Height
	rows := boxAverage(values, radius, height, width, film.Channels, width*film.Channels)
	return boxAverage(rows, radius, width, height, width*film.Channels, film.Channels)
}

// boxAverage averages along one axis: length values spaced by step, on lines spaced by lineStep,
// for each channel.
func boxAverage(in []float64, radius, lines, length, step, lineStep int) []float64 {
	out := make([]float64, len(in))
	for line := range lines {
		for c := range film.Channels {
			base := line*lineStep + c
			for i := range length {
				low, high := max(0, i-radius), min(length-1, i+radius)
				sum := 0.0
				for k := low; k <= high; k++ {
					sum += in[base+k*step]
				}
				out[base+i*step] = sum / float64(high-low+1)
			}
		}
	}
	return out
}

// Luminance weights of linear Rec. 709 RGB.
const (
	lumaR = 0.212671
	lumaG = 0.715160
	lumaB = 0.072169
)

// MeanLuminance of an image of 3 values per pixel.
func MeanLuminance(rgb []float64) float64 {
	sum := 0.0
	for i := 0; i+2 < len(rgb); i += film.Channels {
		sum += lumaR*rgb[i] + lumaG*rgb[i+1] + lumaB*rgb[i+2]
	}
	return ratio(sum, uint64(len(rgb)/film.Channels))
}
