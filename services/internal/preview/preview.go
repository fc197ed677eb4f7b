// Package preview turns developed images into pictures for people: exposure, the sRGB transfer
// curve, 8 bits, PNG. For those who develop them themselves it writes their values.
package preview

import (
	"fmt"
	"image"
	"image/png"
	"io"
	"math"
	"slices"

	"metrofarm/services/internal/job"
)

// Auto returns the exposure that asks for AutoExposure.
func Auto() float64 { return math.NaN() }

// WritePNG writes image as an 8-bit sRGB PNG. Values are multiplied by 2^exposure first; NaN (Auto)
// chooses the exposure from the image.
func WritePNG(w io.Writer, developed job.Image, exposure float64) error {
	if err := checkPixels(developed); err != nil {
		return fmt.Errorf("writing PNG: %w", err)
	}
	if math.IsNaN(exposure) {
		exposure = AutoExposure(developed)
	}
	encoder := png.Encoder{CompressionLevel: png.BestSpeed}
	if err := encoder.Encode(w, toneMap(developed, exposure)); err != nil {
		return fmt.Errorf("writing PNG: %w", err)
	}
	return nil
}

// Parameters of AutoExposure.
const (
	brightQuantile = 0.95  // this pixel ...
	brightTarget   = 0.8   // ... becomes this value before the sRGB curve
	maxStops       = 20.0  // limit of the exposure either way
	luminanceFloor = 1e-20 // darker pixels count as black
)

// AutoExposure returns the exposure, in stops, that shows the image well: the 95th percentile of the
// luminance of the pixels that aren't black becomes 0.8. A quantile does not follow fireflies or a
// small visible lamp, and black surroundings don't count. A black image gets 0.
func AutoExposure(developed job.Image) float64 {
	luminances := make([]float64, 0, len(developed.RGB)/3)
	for i := 0; i+2 < len(developed.RGB); i += 3 {
		y := luminance(developed.RGB[i], developed.RGB[i+1], developed.RGB[i+2])
		if y > luminanceFloor && !math.IsInf(y, 0) {
			luminances = append(luminances, y)
		}
	}
	if len(luminances) == 0 {
		return 0
	}
	slices.Sort(luminances)
	bright := luminances[int(brightQuantile*float64(len(luminances)-1))]
	return min(max(math.Log2(brightTarget/bright), -maxStops), maxStops)
}

func luminance(r, g, b float32) float64 {
	return 0.2126*float64(r) + 0.7152*float64(g) + 0.0722*float64(b)
}

func toneMap(developed job.Image, exposure float64) *image.NRGBA {
	picture := image.NewNRGBA(image.Rect(0, 0, developed.Width, developed.Height))
	scale := math.Exp2(exposure)
	curve := newCurve()
	for i := range developed.Width * developed.Height {
		for c := range 3 {
			picture.Pix[4*i+c] = curve.at(float64(developed.RGB[3*i+c]) * scale)
		}
		picture.Pix[4*i+3] = 255
	}
	return picture
}

// curve tabulates where each 8-bit code of the sRGB transfer curve begins, which is several times
// faster than a power per value and rounds the same.
type curve struct {
	starts [255]float64 // linear value at which code i+1 begins
}

func newCurve() *curve {
	c := &curve{}
	for i := range c.starts {
		c.starts[i] = linearFromSRGB((float64(i) + 0.5) / 255)
	}
	return c
}

// at returns the code of a linear value; NaN and what is negative are black.
func (c *curve) at(linear float64) uint8 {
	low, high := 0, len(c.starts)
	for low < high {
		middle := (low + high) / 2
		if linear >= c.starts[middle] {
			low = middle + 1
		} else {
			high = middle
		}
	}
	return uint8(low)
}

func linearFromSRGB(encoded float64) float64 {
	if encoded <= 0.04045 {
		return encoded / 12.92
	}
	return math.Pow((encoded+0.055)/1.055, 2.4)
}
