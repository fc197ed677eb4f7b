package develop

import (
	"fmt"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

// AcceptanceMap develops a layer in which each of n first-stage proposals adds 1, its acceptance
// probability, and 1 if it is a large step: how many proposals a pixel got relative to an even share
// over so many film cells, the mean of their acceptance probabilities, and the share of large steps
// among them. The latter are 0 where there was none.
func AcceptanceMap(f *film.Film, layer, cells int, n uint64) job.ImageLayer {
	shape := f.Shape()
	sums := make([]float64, shape.Width*shape.Height*film.Channels)
	for h := range film.Halves {
		f.AddPlane(sums, h*shape.Layers+layer, 1)
	}
	values := make([]float32, len(sums))
	for i := 0; i < len(sums); i += film.Channels {
		proposals := sums[i]
		if proposals == 0 {
			continue
		}
		values[i] = float32(ratio(proposals*float64(cells), n))
		values[i+1] = float32(sums[i+1] / proposals)
		values[i+2] = float32(sums[i+2] / proposals)
	}
	return job.ImageLayer{Name: "acceptance", Channels: [3]string{"proposals", "accepted", "large"}, Values: values}
}

// Techniques develops count images by technique from layer first on, each a chain layer and a
// large-step layer with the scales of the image: they sum to what the chains carry of it.
func Techniques(f *film.Film, s Scales, first, count int) []job.ImageLayer {
	shape := f.Shape()
	images := make([]job.ImageLayer, count)
	for t := range images {
		sums := make([]float64, shape.Width*shape.Height*film.Channels)
		for h := range film.Halves {
			for l, scale := range s.Half[h][:2] {
				f.AddPlane(sums, h*shape.Layers+first+2*t+l, s.Weights[h]*scale)
			}
		}
		images[t] = job.ImageLayer{
			Name: fmt.Sprintf("technique.s%d", t), Channels: [3]string{"R", "G", "B"}, Values: make([]float32, len(sums)),
		}
		for i, v := range sums {
			images[t].Values[i] = float32(v)
		}
	}
	return images
}
