package preview_test

import (
	"bytes"
	"image/png"
	"math"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/preview"
)

func gray(width, height int, value float32) job.Image {
	image := job.Image{Width: width, Height: height, RGB: make([]float32, 3*width*height)}
	for i := range image.RGB {
		image.RGB[i] = value
	}
	return image
}

func firstPixel(t *testing.T, image job.Image, exposure float64) uint32 {
	t.Helper()
	var buffer bytes.Buffer
	if err := preview.WritePNG(&buffer, image, exposure); err != nil {
		t.Fatal(err)
	}
	decoded, err := png.Decode(&buffer)
	if err != nil {
		t.Fatal(err)
	}
	r, _, _, a := decoded.At(0, 0).RGBA()
	if a != 0xffff {
		t.Fatalf("alpha %#x, want opaque", a)
	}
	return r >> 8
}

func TestSRGBTransfer(t *testing.T) {
	// Known pairs of IEC 61966-2-1; each exposure stop doubles the value.
	cases := []struct {
		linear   float32
		exposure float64
		want     uint32
	}{
		{0, 0, 0},
		{1, 0, 255},
		{0.18, 0, 118},
		{0.5, 0, 188},
		{0.25, 1, 188},
		{2, -2, 188},
		{0.0031308, 0, 10},
		{100, 0, 255},
		{-1, 0, 0},
		{float32(math.NaN()), 0, 0},
		{float32(math.Inf(1)), 0, 255},
	}
	for _, c := range cases {
		if got := firstPixel(t, gray(1, 1, c.linear), c.exposure); got != c.want {
			t.Errorf("linear %v at %v stops: %d, want %d", c.linear, c.exposure, got, c.want)
		}
	}
}

func TestAutoExposureIgnoresFirefliesBlackAndScale(t *testing.T) {
	image := gray(20, 20, 0.01)
	want := preview.AutoExposure(image)
	if math.Abs(want-math.Log2(80)) > 1e-3 {
		t.Fatalf("exposure %v for a gray of 0.01, want log2(0.8/0.01)", want)
	}
	for i := range 3 * 9 { // nine fireflies of 400 pixels
		image.RGB[i] = 1e6
	}
	for i := 3 * 100; i < 3*300; i++ { // half of it black
		image.RGB[i] = 0
	}
	image.RGB[3*310] = float32(math.NaN())
	if got := preview.AutoExposure(image); math.Abs(got-want) > 1e-6 {
		t.Errorf("exposure %v with fireflies, black and NaN, want %v", got, want)
	}
}

func TestAutoExposureOfBlackIsZero(t *testing.T) {
	if got := preview.AutoExposure(gray(4, 4, 0)); got != 0 {
		t.Errorf("exposure %v, want 0", got)
	}
	if got := firstPixel(t, gray(4, 4, 0), preview.Auto()); got != 0 {
		t.Errorf("black became %d", got)
	}
}

func TestWritePNGRefusesImpossibleImages(t *testing.T) {
	for want, image := range map[string]job.Image{
		"no pixels":        {},
		"2 values, want 3": {Width: 1, Height: 1, RGB: []float32{0, 0}},
	} {
		err := preview.WritePNG(&bytes.Buffer{}, image, 0)
		if err == nil || !strings.Contains(err.Error(), want) {
			t.Errorf("error %v, want one with %q", err, want)
		}
	}
}
