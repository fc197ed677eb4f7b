package develop

import "metrofarm/services/internal/film"

// smoothRadius of the variance image: a box of 5 x 5 pixels.
const smoothRadius = 2

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
	width, height := m.Shape.Width, m.Shape.Height
	rows := boxAverage(raw, height, width, film.Channels, width*film.Channels)
	both := boxAverage(rows, width, height, width*film.Channels, film.Channels)
	out := make([]float32, len(both))
	for i, v := range both {
		out[i] = float32(v)
	}
	return out
}

// boxAverage averages along one axis: length values spaced by step, on lines spaced by lineStep,
// for each channel.
func boxAverage(in []float64, lines, length, step, lineStep int) []float64 {
	out := make([]float64, len(in))
	for line := range lines {
		for c := range film.Channels {
			base := line*lineStep + c
			for i := range length {
				low, high := max(0, i-smoothRadius), min(length-1, i+smoothRadius)
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
