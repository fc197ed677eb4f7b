package cli

import (
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"os"
	"path/filepath"

	"metrofarm/services/internal/explain"
	"metrofarm/services/internal/job"
)

// output is a file to write.
type output struct {
	path  string // "": don't
	write func(io.Writer) error
}

// writeOutputs writes all files or none: each under a temporary name first, all renamed once every
// one is complete.
func writeOutputs(outputs ...output) (err error) {
	staged := make(map[string]string) // temporary to final
	defer func() {
		for temporary := range staged {
			os.Remove(temporary) // fails after the rename, as it should
		}
	}()
	for _, o := range outputs {
		if o.path == "" {
			continue
		}
		final, temporary, err := stage(o)
		if err != nil {
			return fmt.Errorf("%s: %w", o.path, err)
		}
		if temporary != "" {
			staged[temporary] = final
		}
	}
	for temporary, final := range staged {
		if err := os.Rename(temporary, final); err != nil {
			return err
		}
	}
	return nil
}

// stage writes a temporary file beside the final one. What is no regular file (/dev/null, a pipe)
// is written directly, and has no temporary.
func stage(o output) (final, temporary string, err error) {
	final = o.path
	if resolved, err := filepath.EvalSymlinks(o.path); err == nil {
		final = resolved
	}
	if info, err := os.Stat(final); err == nil && !info.Mode().IsRegular() {
		return "", "", writeTo(final, os.O_WRONLY, o.write)
	}
	temporary = fmt.Sprintf("%s.%d.tmp", final, os.Getpid())
	if err := writeTo(temporary, os.O_WRONLY|os.O_CREATE|os.O_TRUNC, o.write); err != nil {
		os.Remove(temporary)
		return "", "", err
	}
	return final, temporary, nil
}

func writeTo(path string, mode int, write func(io.Writer) error) error {
	file, err := os.OpenFile(path, mode, 0o666)
	if err != nil {
		return err
	}
	return errors.Join(write(file), file.Close())
}

// checkOutputs finds hopeless output paths before hours of rendering.
func checkOutputs(paths ...string) error {
	for _, path := range paths {
		if path == "" {
			continue
		}
		if info, err := os.Stat(path); err == nil && info.IsDir() {
			return usagef("%s is a folder; name a file", path)
		}
		if info, err := os.Stat(filepath.Dir(path)); err != nil || !info.IsDir() {
			return usagef("%s: there is no folder %s", path, filepath.Dir(path))
		}
	}
	return nil
}

// estimate is a value with its confidence interval.
type estimate struct {
	Value float64 `json:"value"`
	job.Interval
}

// statistics is the document of --stats. Its keys are an interface: scripts read them.
type statistics struct {
	Integrator      string            `json:"integrator"`
	Seed            uint64            `json:"seed"`
	Width           int               `json:"width"`
	Height          int               `json:"height"`
	Mutations       uint64            `json:"mutations"`
	PathEvaluations uint64            `json:"path_evaluations"`
	Rays            uint64            `json:"rays"`
	Rounds          int               `json:"rounds"`
	CPUSeconds      float64           `json:"cpu_seconds"`
	WallSeconds     float64           `json:"wall_seconds"`
	LoadSeconds     float64           `json:"load_seconds"`
	B               float64           `json:"b"`
	BStandardError  float64           `json:"b_standard_error"`
	Acceptance      acceptance        `json:"acceptance"`
	Coordinates     float64           `json:"coordinates_per_mutation"`
	Lengths         []job.Length      `json:"lengths,omitempty"`
	Techniques      []job.Technique   `json:"techniques,omitempty"`
	Effective       float64           `json:"effective_samples"`
	EffectiveShare  float64           `json:"effective_samples_per_mutation"`
	LongestStay     uint64            `json:"longest_stay"`
	TrappedChains   uint64            `json:"trapped_chains"`
	RelMSE          *estimate         `json:"rel_mse_estimate"`
	Anomalies       map[string]uint64 `json:"anomalies"`
	FilmSHA256      string            `json:"film_sha256"`
	Plan            explain.Plan      `json:"plan"`
	ResolvedSpec    json.RawMessage   `json:"resolved_spec"`
}

// acceptance ratios; null for a kind of step that never ran.
type acceptance struct {
	Large *float64 `json:"large"`
	Small *float64 `json:"small"`
	// Subpath steps draw one subpath anew.
	Subpath *float64 `json:"subpath"`
	Second  *float64 `json:"second"`
	// SecondAfterLarge counts the second stages that follow rejected large steps.
	SecondAfterLarge *float64 `json:"second_after_large"`
}

// statisticsOf a job; report is its scene report in protobuf JSON.
func statisticsOf(s job.Snapshot, report string) (statistics, error) {
	plan, err := explain.Of(s, report)
	if err != nil {
		return statistics{}, err
	}
	stats := statistics{
		Integrator: s.Integrator, Seed: s.Seed, Width: s.Width, Height: s.Height,
		Mutations: s.Mutations, PathEvaluations: s.PathEvaluations, Rays: s.Rays, Rounds: s.RoundsDone,
		CPUSeconds: s.CPUSeconds, WallSeconds: s.WallSeconds, LoadSeconds: s.LoadSeconds,
		B: s.B, BStandardError: s.BStandardError,
		Acceptance: acceptance(s.Acceptance), Coordinates: s.CoordinatesPerMutation, Lengths: s.Lengths,
		Techniques: s.Techniques, Effective: s.EffectiveSamples, EffectiveShare: s.EffectiveSamplesPerMutation,
		LongestStay: s.LongestStay, TrappedChains: s.TrappedChains,
		Anomalies: s.Anomalies, FilmSHA256: s.FilmSHA256, Plan: plan,
		ResolvedSpec: json.RawMessage(s.Resolved),
	}
	if stats.Anomalies == nil {
		stats.Anomalies = map[string]uint64{}
	}
	if s.Resolved == "" {
		stats.ResolvedSpec = json.RawMessage("null")
	}
	if s.RelMSE != nil {
		stats.RelMSE = &estimate{Value: *s.RelMSE}
		if s.RelMSEInterval != nil {
			stats.RelMSE.Interval = *s.RelMSEInterval
		}
	}
	return stats, nil
}

func writeStatistics(w io.Writer, s job.Snapshot, report string) error {
	stats, err := statisticsOf(s, report)
	if err != nil {
		return err
	}
	return writeJSON(w, stats)
}

func writeJSON(w io.Writer, value any) error {
	encoder := json.NewEncoder(w)
	encoder.SetEscapeHTML(false)
	encoder.SetIndent("", "  ")
	return encoder.Encode(value)
}
