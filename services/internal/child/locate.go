// Package child runs the C++ worker program as a child process: as a local worker that is kept
// alive, and as a tool that lists the files of a scene.
package child

import (
	"bytes"
	"context"
	"errors"
	"fmt"
	"os"
	"os/exec"
	"path/filepath"
	"strings"
)

// Program is the worker's file name.
const Program = "metrofarm-worker"

// EnvironmentVariable names the worker program where it is not next to ours.
const EnvironmentVariable = "METROFARM_WORKER"

// Locate finds the worker program: named by the environment, or next to this executable.
func Locate(getenv func(string) string) (string, error) {
	if named := getenv(EnvironmentVariable); named != "" {
		return checkProgram(named, EnvironmentVariable+" names it")
	}
	executable, err := os.Executable()
	if err != nil {
		return "", fmt.Errorf("finding %s: %w", Program, err)
	}
	if executable, err = filepath.EvalSymlinks(executable); err != nil {
		return "", fmt.Errorf("finding %s: %w", Program, err)
	}
	return checkProgram(filepath.Join(filepath.Dir(executable), Program),
		"it belongs next to metrofarm; "+EnvironmentVariable+" can name another place")
}

func checkProgram(path, hint string) (string, error) {
	info, err := os.Stat(path)
	if err == nil && (info.IsDir() || info.Mode()&0o111 == 0) {
		err = errors.New("not a program")
	}
	if err != nil {
		return "", fmt.Errorf("worker program %s: %w (%s)", path, err, hint)
	}
	return filepath.Abs(path)
}

// SceneError is what the worker program says about a scene that it cannot read: usually
// "file:line: message".
type SceneError struct{ Message string }

func (e *SceneError) Error() string { return e.Message }

// Files lists all files that a scene consists of, the scene file included, and with a slash at the
// end the folders in which it has files looked for; all as absolute paths.
// sets are NAME=VALUE overrides of the scene's <default> values.
func Files(ctx context.Context, program, scene string, sets []string, lenient bool) ([]string, error) {
	output, err := look(ctx, program, "files", scene, sets, lenient)
	if err != nil {
		return nil, err
	}
	return lines(string(output)), nil
}

// Inspect asks the worker program what is in a scene: metrofarm.scene.v1.SceneReport in protobuf
// JSON. A fault of the scene is a *SceneError.
func Inspect(ctx context.Context, program, scene string, sets []string, lenient bool) ([]byte, error) {
	return look(ctx, program, "inspect", scene, sets, lenient)
}

// look runs one of the worker's commands that only read a scene.
func look(ctx context.Context, program, command, scene string, sets []string, lenient bool) ([]byte, error) {
	arguments := []string{command, scene}
	for _, set := range sets {
		arguments = append(arguments, "--set", set)
	}
	if lenient {
		arguments = append(arguments, "--lenient")
	}
	run := exec.CommandContext(ctx, program, arguments...)
	var stdout, stderr bytes.Buffer
	run.Stdout, run.Stderr = &stdout, &stderr
	if err := run.Run(); err != nil {
		var exit *exec.ExitError
		if message := strings.TrimSpace(stderr.String()); errors.As(err, &exit) && message != "" && ctx.Err() == nil {
			return nil, &SceneError{withoutPrefix(message)}
		}
		return nil, fmt.Errorf("looking at %s: %w", scene, err)
	}
	return stdout.Bytes(), nil
}

// withoutPrefix drops the program's name, since the message will stand behind ours.
func withoutPrefix(message string) string {
	return strings.TrimPrefix(message, Program+": ")
}

func lines(text string) []string {
	var found []string
	for line := range strings.SplitSeq(text, "\n") {
		if line != "" {
			found = append(found, line)
		}
	}
	return found
}
