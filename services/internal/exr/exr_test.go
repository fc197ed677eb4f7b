package exr_test

import (
	"bytes"
	"errors"
	"math"
	"strings"
	"testing"

	"metrofarm/services/internal/exr"
	"metrofarm/services/internal/job"
)

func sample(width, height int) job.Image {
	image := job.Image{
		Width: width, Height: height,
		RGB:         make([]float32, 3*width*height),
		Variance:    make([]float32, 3*width*height),
		SceneDigest: "ab12", FilmSHA256: "cd34", Integrator: "pssmlt", JobID: "job-1",
		Seed: math.MaxUint64, Mutations: 1 << 40, Rounds: 7,
		B: 0.25, BStandardError: 0.0625, RelMSE: 1e-3,
	}
	for i := range image.RGB {
		image.RGB[i] = float32(i) * 0.37
		image.Variance[i] = float32(i) * 1e-9
	}
	return image
}

func roundTrip(t *testing.T, image job.Image, options exr.Options) exr.File {
	t.Helper()
	var buffer bytes.Buffer
	if err := exr.Write(&buffer, image, options); err != nil {
		t.Fatal(err)
	}
	file, err := exr.Read(&buffer)
	if err != nil {
		t.Fatal(err)
	}
	return file
}

func TestFloatRoundTripIsExact(t *testing.T) {
	// Sizes around ZIP's 16-line blocks.
	for _, size := range [][2]int{{1, 1}, {5, 3}, {7, 16}, {33, 17}, {3, 100}} {
		image := sample(size[0], size[1])
		file := roundTrip(t, image, exr.Options{Variance: true})
		if file.Width != size[0] || file.Height != size[1] {
			t.Fatalf("size %d x %d, want %v", file.Width, file.Height, size)
		}
		for c, name := range []string{"R", "G", "B"} {
			for i, value := range file.Channels[name] {
				if value != image.RGB[3*i+c] {
					t.Fatalf("%v: %s[%d] = %v, want %v", size, name, i, value, image.RGB[3*i+c])
				}
			}
			for i, value := range file.Channels["variance."+name] {
				if value != image.Variance[3*i+c] {
					t.Fatalf("%v: variance.%s[%d] = %v, want %v", size, name, i, value, image.Variance[3*i+c])
				}
			}
		}
	}
}

func TestLayersComeBackExactly(t *testing.T) {
	image := sample(33, 17)
	for i, name := range []string{"acceptance", "technique.s0", "technique.s4"} {
		layer := job.ImageLayer{Name: name, Channels: [3]string{"R", "G", "B"}, Values: make([]float32, len(image.RGB))}
		for k := range layer.Values {
			layer.Values[k] = float32(k) * (0.1 + float32(i))
		}
		image.Layers = append(image.Layers, layer)
	}
	file := roundTrip(t, image, exr.Options{Half: true, Variance: true})
	if len(file.Channels) != 15 {
		t.Fatalf("%d channels", len(file.Channels))
	}
	for _, layer := range image.Layers {
		for c, channel := range layer.Channels {
			name := layer.Name + "." + channel
			for i, value := range file.Channels[name] {
				if value != layer.Values[3*i+c] || file.Half[name] {
					t.Fatalf("%s[%d] = %v, want %v", name, i, value, layer.Values[3*i+c])
				}
			}
		}
	}
	image.Layers[1].Values = image.Layers[1].Values[1:]
	if err := exr.Write(&bytes.Buffer{}, image, exr.Options{}); err == nil || !strings.Contains(err.Error(), "technique.s0") {
		t.Errorf("a layer of another size: %v", err)
	}
}

func TestAttributes(t *testing.T) {
	file := roundTrip(t, sample(2, 2), exr.Options{})
	want := map[string]string{
		"software": "Metrofarm", "sceneDigest": "ab12", "filmSHA256": "cd34", "integrator": "pssmlt",
		"jobId": "job-1", "seed": "18446744073709551615", "mutations": "1099511627776",
		"rounds": "7", "b": "0.25", "bStandardError": "0.0625", "relMSE": "0.00100000005",
	}
	for name, value := range want {
		if file.Attributes[name] != value {
			t.Errorf("attribute %s = %q, want %q", name, file.Attributes[name], value)
		}
	}
}

func TestHalfKeepsRelativePrecisionAndVarianceAsFloat(t *testing.T) {
	image := sample(9, 9)
	file := roundTrip(t, image, exr.Options{Half: true, Variance: true})
	if !file.Half["G"] || file.Half["variance.G"] {
		t.Fatalf("half channels %v: want G but not variance.G", file.Half)
	}
	for i, value := range file.Channels["G"] {
		want := float64(image.RGB[3*i+1])
		if math.Abs(float64(value)-want) > want/2048 {
			t.Fatalf("G[%d] = %v, want %v", i, value, want)
		}
		if file.Channels["variance.G"][i] != image.Variance[3*i+1] {
			t.Fatalf("variance.G[%d] lost precision", i)
		}
	}
}

func TestHalfStaysFinite(t *testing.T) {
	image := sample(1, 1)
	image.RGB = []float32{1e9, -1e9, 65504}
	file := roundTrip(t, image, exr.Options{Half: true})
	for name, want := range map[string]float32{"R": 65504, "G": -65504, "B": 65504} {
		if got := file.Channels[name][0]; got != want {
			t.Errorf("%s = %v, want %v", name, got, want)
		}
	}
}

func TestWriteRefusesImpossibleImages(t *testing.T) {
	noVariance := sample(2, 2)
	noVariance.Variance = nil
	short := sample(2, 2)
	short.RGB = short.RGB[1:]
	cases := map[string]struct {
		image   job.Image
		options exr.Options
		want    string
	}{
		"no pixels":   {job.Image{}, exr.Options{}, "size 0 x 0"},
		"too wide":    {job.Image{Width: exr.MaxSide + 1, Height: 1}, exr.Options{}, "1 to 32768"},
		"short":       {short, exr.Options{}, "11 RGB values"},
		"no variance": {noVariance, exr.Options{Variance: true}, "0 variances"},
	}
	for name, c := range cases {
		err := exr.Write(&bytes.Buffer{}, c.image, c.options)
		if err == nil || !strings.Contains(err.Error(), c.want) {
			t.Errorf("%s: error %v, want one with %q", name, err, c.want)
		}
	}
}

var errFull = errors.New("disk full")

type fullWriter struct{}

func (fullWriter) Write([]byte) (int, error) { return 0, errFull }

func TestWriteReportsTheWritersError(t *testing.T) {
	if err := exr.Write(fullWriter{}, sample(2, 2), exr.Options{}); !errors.Is(err, errFull) {
		t.Errorf("error %v, want %v", err, errFull)
	}
}

// Exceptions of the C++ library must arrive as errors, whatever the bytes are.
func TestReadReturnsErrorsForDamagedFiles(t *testing.T) {
	var buffer bytes.Buffer
	if err := exr.Write(&buffer, sample(8, 8), exr.Options{}); err != nil {
		t.Fatal(err)
	}
	whole := buffer.Bytes()
	for _, size := range []int{0, 1, 4, 20, len(whole) / 2, len(whole) - 1} {
		if _, err := exr.Read(bytes.NewReader(whole[:size])); err == nil {
			t.Errorf("the first %d of %d bytes were read without an error", size, len(whole))
		}
	}
	if _, err := exr.Read(strings.NewReader("not an EXR file at all")); err == nil {
		t.Error("text was read without an error")
	}
}
